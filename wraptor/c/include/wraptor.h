#ifndef WRAPTOR_H
#define WRAPTOR_H

/* Generated from wraptor/c/src by `cargo xtask c-library`. C library of a robot hand: docs/c-library.md. */

#include <stdint.h>
#include <stddef.h>

/*
 A limit that never ends: the manual's functions wait like this.
 */
#define WRAPTOR_ENDLESS 4294967295

/*
 Rows of the list: nodes 0 to 7.
 */
#define WRAPTOR_NODES 8

/*
 Columns of the list: properties.
 */
#define WRAPTOR_PROPERTIES 128

/*
 What a function returns.
 */
typedef enum wraptor_error {
    /*
     Done.
     */
    WRAPTOR_OK = 0,
    /*
     A pointer is NULL that must not be; nothing was sent.
     */
    WRAPTOR_NULL = 1,
    /*
     No connection has this number: it was never made, or is closed.
     */
    WRAPTOR_BAD_HANDLE = 2,
    /*
     An argument is wrong, such as an unknown node or a value out of range, or a callback uses its own connection; nothing was sent.
     */
    WRAPTOR_INVALID = 3,
    /*
     Not done within the limit. A motion or a line of the language was told to abort; a get or a wait stops no motor.
     */
    WRAPTOR_TIMED_OUT = 4,
    /*
     The connection is lost.
     */
    WRAPTOR_LOST = 5,
    /*
     Ended by `wraptor_cancel`, by `wraptor_close_connection`, or by ^C.
     */
    WRAPTOR_CANCELLED = 6,
    /*
     The hand answered ERR; `wraptor_error_status` has its number.
     */
    WRAPTOR_STATUS = 7,
    /*
     Motor boards do not answer.
     */
    WRAPTOR_NO_ANSWER = 8,
    /*
     A motion ended early.
     */
    WRAPTOR_NOT_REACHED = 9,
    /*
     No connection was made.
     */
    WRAPTOR_NOT_CONNECTED = 10,
    /*
     A file cannot be read, or is no firmware.
     */
    WRAPTOR_FILE = 11,
    /*
     What was received is not of the protocol, or a board does not do what it was told.
     */
    WRAPTOR_UNEXPECTED = 12,
    /*
     A download ended without the new application.
     */
    WRAPTOR_DOWNLOAD = 13,
    /*
     A defect of this library. The connection is closed.
     */
    WRAPTOR_INTERNAL = 14,
} wraptor_error;

/*
 A property of a motor board, by its name in docs/properties.md, with its unit.
 */
typedef enum wraptor_property {
    /*
     firmware version; in the monitor the monitor's; there SET 170 starts a download
     */
    WRAPTOR_PROPERTY_VERS = 0,
    /*
     3 (this hand's motor board) | 0x0800 (has a strain gauge); unit: bits
     */
    WRAPTOR_PROPERTY_ROLE = 1,
    /*
     serial number
     */
    WRAPTOR_PROPERTY_SN = 2,
    /*
     the board's node on the bus; the straps' until set; a new one is heard from the next start on
     */
    WRAPTOR_PROPERTY_ID = 3,
    /*
     latched fault, see the fault table; 0 none; SET STAT 2 clears it; unit: code
     */
    WRAPTOR_PROPERTY_ERROR = 4,
    /*
     0 in the monitor, waiting for firmware; 1 must not be used; 2 ready. SET 0 resets into the monitor, SET 2 wakes, or clears ERROR
     */
    WRAPTOR_PROPERTY_STAT = 5,
    /*
     control mode, see the mode table; 1 is refused; a move that 5 orders ends in 3
     */
    WRAPTOR_PROPERTY_MODE = 8,
    /*
     temperature of the board; unit: 0.1 C
     */
    WRAPTOR_PROPERTY_TEMP = 9,
    /*
     highest TEMP ever; kept through power loss; unit: 0.1 C
     */
    WRAPTOR_PROPERTY_PTEMP = 10,
    /*
     the motor's temperature limit: torque derates over the 8 C below it and is cut at it; -551 disables it and the check for a broken thermistor wire (decision 0014); -550 to 199 is refused; unit: 0.1 C
     */
    WRAPTOR_PROPERTY_OTEMP = 11,
    /*
     18384, 23, 3145, 1024, 1 in this order unlock the next SET of a locked property, once
     */
    WRAPTOR_PROPERTY_LOCK = 13,
    /*
     brake output: 1 energized, the spread is free
     */
    WRAPTOR_PROPERTY_B = 16,
    /*
     raw analog input 0: strain gauge; unit: ADC
     */
    WRAPTOR_PROPERTY_ANA0 = 18,
    /*
     raw analog input 1: motor thermistor; unit: ADC
     */
    WRAPTOR_PROPERTY_ANA1 = 19,
    /*
     motor temperature; unit: 0.1 C
     */
    WRAPTOR_PROPERTY_THERM = 20,
    /*
     bus voltage; unit: 0.1 V
     */
    WRAPTOR_PROPERTY_VBUS = 21,
    /*
     bus current; phase current is this over the duty; unit: mA
     */
    WRAPTOR_PROPERTY_IMOTOR = 22,
    /*
     strain gauge
     */
    WRAPTOR_PROPERTY_SG = 25,
    /*
     first group listened to; group 0 is always heard
     */
    WRAPTOR_PROPERTY_GRPA = 26,
    /*
     second group listened to: 1 for nodes 1 to 4, 2 for 5 to 7, 7 for 11 to 17 as in Barrett's hands
     */
    WRAPTOR_PROPERTY_GRPB = 27,
    /*
     third group listened to: 4, or 5 for nodes 11 to 17
     */
    WRAPTOR_PROPERTY_GRPC = 28,
    /*
     does what the command table says
     */
    WRAPTOR_PROPERTY_CMD = 29,
    /*
     stores the present value of the property of this number; -1: of all; unit: id
     */
    WRAPTOR_PROPERTY_SAVE = 30,
    /*
     takes the stored value, or the default, of the property of this number; -1: of all; unit: id
     */
    WRAPTOR_PROPERTY_LOAD = 31,
    /*
     resets the property of this number, and its stored value, to its default; -1: all; unit: id
     */
    WRAPTOR_PROPERTY_DEF = 32,
    /*
     SET: learns how the motor is wired, see the table of FIND; GET: what is known, or why it was refused
     */
    WRAPTOR_PROPERTY_FIND = 33,
    /*
     the host's to use; means nothing to the board
     */
    WRAPTOR_PROPERTY_X0 = 34,
    /*
     the host's to use; means nothing to the board
     */
    WRAPTOR_PROPERTY_X1 = 35,
    /*
     the host's to use; means nothing to the board
     */
    WRAPTOR_PROPERTY_X2 = 36,
    /*
     the host's to use; means nothing to the board
     */
    WRAPTOR_PROPERTY_X3 = 37,
    /*
     the host's to use; means nothing to the board
     */
    WRAPTOR_PROPERTY_X4 = 38,
    /*
     the host's to use; means nothing to the board
     */
    WRAPTOR_PROPERTY_X5 = 39,
    /*
     the host's to use; means nothing to the board
     */
    WRAPTOR_PROPERTY_X6 = 40,
    /*
     the host's to use; means nothing to the board
     */
    WRAPTOR_PROPERTY_X7 = 41,
    /*
     SET: torque of mode 2; GET: in mode 2 the torque commanded, after every limit, else the torque applied. Packed torques saturate at MT; unit: 1/1024 peak
     */
    WRAPTOR_PROPERTY_T = 42,
    /*
     torque limit; unit: 1/1024 peak
     */
    WRAPTOR_PROPERTY_MT = 43,
    /*
     SET: velocity of mode 4, until a motion ends (VSET shows it); GET: in mode 4 the velocity commanded, else the measured one; unit: counts/s
     */
    WRAPTOR_PROPERTY_V = 44,
    /*
     cruise velocity of trapezoidal moves, together with MCV and MOV; unit: counts/s
     */
    WRAPTOR_PROPERTY_MV = 45,
    /*
     cruise velocity when closing; unit: counts/s
     */
    WRAPTOR_PROPERTY_MCV = 46,
    /*
     cruise velocity when opening; unit: counts/s
     */
    WRAPTOR_PROPERTY_MOV = 47,
    /*
     position; set in idle it says what the present position is called, in mode 3 where to go; within the goals of KIND; GET is answered by the 22-bit position frame; unit: counts
     */
    WRAPTOR_PROPERTY_P = 48,
    /*
     motor: resistance line to line at 25 C; MKT, MJ and ML stay; unit: mOhm
     */
    WRAPTOR_PROPERTY_MR = 49,
    /*
     default position: where CMD M goes; ends at the goals of KIND; unit: counts
     */
    WRAPTOR_PROPERTY_DP = 50,
    /*
     motor: peak current of a phase, which gives T 1024; MKT, MJ and ML stay; unit: mA
     */
    WRAPTOR_PROPERTY_MPK = 51,
    /*
     where a trapezoidal move ends; during a move it re-plans; beyond the goals of KIND it is refused; unit: counts
     */
    WRAPTOR_PROPERTY_E = 52,
    /*
     motor: torque constant, which is the EMF in uV.s/rad; a view of MKE, which stores it; unit: uN.m/A
     */
    WRAPTOR_PROPERTY_MKT = 53,
    /*
     open target: where CMD O goes; ends at the goals of KIND; unit: counts
     */
    WRAPTOR_PROPERTY_OT = 54,
    /*
     motor: inertia with its load, at the motor; a view of MKA, which stores it; unit: 1e-11 kg.m2
     */
    WRAPTOR_PROPERTY_MJ = 55,
    /*
     close target: where CMD C goes; ends at the goals of KIND; unit: counts
     */
    WRAPTOR_PROPERTY_CT = 56,
    /*
     motor: inductance line to line; a view of MTE, which stores it; unit: 0.1 uH
     */
    WRAPTOR_PROPERTY_ML = 57,
    /*
     E and a move to it in one, HOLD says how it ends; beyond the goals of KIND it is refused; unit: counts
     */
    WRAPTOR_PROPERTY_M = 58,
    /*
     nominal voltage of the supply; unit: 0.1 V
     */
    WRAPTOR_PROPERTY_MVN = 59,
    /*
     default step of CMD IC and IO, which end at the goals of KIND; unit: counts
     */
    WRAPTOR_PROPERTY_DS = 60,
    /*
     time with power on, ever; unit: s
     */
    WRAPTOR_PROPERTY_UPSECS = 63,
    /*
     odometer: way of the motor in both directions, ever; CTS counts a revolution; unit: revolutions
     */
    WRAPTOR_PROPERTY_OD = 64,
    /*
     position within one motor revolution; unit: counts
     */
    WRAPTOR_PROPERTY_MECH = 66,
    /*
     motor: highest temperature of the winding; unit: 0.1 C
     */
    WRAPTOR_PROPERTY_MWX = 67,
    /*
     counts a motor revolution: three times POLES; unit: counts
     */
    WRAPTOR_PROPERTY_CTS = 68,
    /*
     motor: heat capacity of the winding; unit: 0.01 J/K
     */
    WRAPTOR_PROPERTY_MWJ = 69,
    /*
     the board's slot in packed-torque frames
     */
    WRAPTOR_PROPERTY_PIDX = 70,
    /*
     strain above which a move ends; 0, 255 and 256 disable
     */
    WRAPTOR_PROPERTY_HSG = 71,
    /*
     strain below which a move ends; 0, 255 and 256 disable
     */
    WRAPTOR_PROPERTY_LSG = 72,
    /*
     velocity towards the stop in HI (tips home on their closed stop); unit: counts/s
     */
    WRAPTOR_PROPERTY_IVEL = 73,
    /*
     way from the stop to zero in HI; at most the joint's width and 8 in either direction; unit: counts
     */
    WRAPTOR_PROPERTY_IOFF = 74,
    /*
     motor: thermal resistance from winding to housing; unit: 0.01 K/W
     */
    WRAPTOR_PROPERTY_MWR = 75,
    /*
     arrival window; unit: counts
     */
    WRAPTOR_PROPERTY_MPE = 76,
    /*
     after a motion: 1 holds the position, 0 idles; a move that MODE 5 orders holds with either, but not with HOSTUNITS 280
     */
    WRAPTOR_PROPERTY_HOLD = 77,
    /*
     no count for this long while driven is a stall; 0 never; unit: ms
     */
    WRAPTOR_PROPERTY_TSTOP = 78,
    /*
     position gain; unit: 1/1024 peak per count
     */
    WRAPTOR_PROPERTY_KP = 79,
    /*
     derivative gain, beyond the EMF's own damping; unit: 1/256 of 1/1024 peak per count/s
     */
    WRAPTOR_PROPERTY_KD = 80,
    /*
     integral gain; loads are carried without it; unit: 1/1024 peak per count s
     */
    WRAPTOR_PROPERTY_KI = 81,
    /*
     acceleration is (ACCEL/1024)^2 counts/ms^2; useful up to about 60; 0 cannot move; unit: sqrt(counts)/ms/1024
     */
    WRAPTOR_PROPERTY_ACCEL = 82,
    /*
     joint index
     */
    WRAPTOR_PROPERTY_JIDX = 85,
    /*
     torque units per newton meter at the motor; unit: 1/N.m
     */
    WRAPTOR_PROPERTY_IPNM = 86,
    /*
     present hall code; unit: bits
     */
    WRAPTOR_PROPERTY_HALLS = 87,
    /*
     the last ten hall codes, the newest in the low three bits; bit 30: the position is known (HI, or stored and not moved since); unit: bits
     */
    WRAPTOR_PROPERTY_HALLH = 88,
    /*
     bandwidth of the position loop, from which the gains are computed for the motor as it is described; 0: KP, KD and KPV hold. 166 is theirs; unit: 0.1 Hz
     */
    WRAPTOR_PROPERTY_KBW = 89,
    /*
     motor: poles of the rotor, an even number; MKT, MJ and ML stay
     */
    WRAPTOR_PROPERTY_POLES = 90,
    /*
     whether the hand's commands without a motor prefix act on this motor; GOD's to obey
     */
    WRAPTOR_PROPERTY_EN = 94,
    /*
     whether the board can drive the motor as it is described: 0 it can; else why not, see the table of FIT, and nothing moves; unit: code
     */
    WRAPTOR_PROPERTY_FIT = 95,
    /*
     joint: lowest whole count; goals go 8 beyond; unit: counts
     */
    WRAPTOR_PROPERTY_JLO = 97,
    /*
     joint: highest whole count; goals go 8 beyond; unit: counts
     */
    WRAPTOR_PROPERTY_JHI = 99,
    /*
     RealTime velocity bytes are multiplied by this; GOD's to obey
     */
    WRAPTOR_PROPERTY_LCVC = 105,
    /*
     torque limit in HI; unit: 1/1024 peak
     */
    WRAPTOR_PROPERTY_IHIT = 108,
    /*
     velocity gain of mode 4 (RealTime's proportional gain); unit: 1/16 of 1/1024 peak per count/s
     */
    WRAPTOR_PROPERTY_KPV = 109,
    /*
     a breakaway stops the finger's tip too; GOD's to obey
     */
    WRAPTOR_PROPERTY_BS = 110,
    /*
     a breakaway has been detected; CMD O clears it
     */
    WRAPTOR_PROPERTY_BD = 111,
    /*
     position of the last breakaway; unit: counts
     */
    WRAPTOR_PROPERTY_BP = 112,
    /*
     load torque at which a link breaks away; 0 never; unit: 1/1024 peak
     */
    WRAPTOR_PROPERTY_BT = 114,
    /*
     why the last motion ended, see the end table; 0 it has not
     */
    WRAPTOR_PROPERTY_END = 115,
    /*
     bit 0: report ends of moves unasked (MODE, then END); bit 1: report breakaways (BD); unit: bits
     */
    WRAPTOR_PROPERTY_LFLAGS = 116,
    /*
     the measured velocity in any mode: what RealTime feeds back, whose V is the command; unit: counts/s
     */
    WRAPTOR_PROPERTY_VEL = 117,
    /*
     0 unknown: the motor does not move; else 1 + 2 x the wiring's number, plus 1 if the direction of closing is known. 2 as shipped; FIND stores it
     */
    WRAPTOR_PROPERTY_WIRING = 118,
    /*
     in mode 2 or 4 set by a host, no frame to this board or its groups for this long ends the motion with ERROR 7; 0 never; unit: ms
     */
    WRAPTOR_PROPERTY_HOSTMS = 119,
    /*
     kind of motor: 1 link, 2 spread, 3 tip; goals are -33 to 346, -8 to 174, -166 to 358; by the straps, or without straps by the node, until set; a new one counts from the next start on
     */
    WRAPTOR_PROPERTY_KIND = 120,
    /*
     V as set: mode 4 runs at it, or will when it starts; 0 once any motion has ended; unit: counts/s
     */
    WRAPTOR_PROPERTY_VSET = 121,
    /*
     motor model: acceleration of motor and joint by torque; unit: 1/16 count/s2 per 1/1024 peak
     */
    WRAPTOR_PROPERTY_MKA = 122,
    /*
     motor model: EMF; 1024 torque units are the voltage MR MPK, 24 V; unit: 1/4096 of 1/1024 peak per count/s
     */
    WRAPTOR_PROPERTY_MKE = 123,
    /*
     motor model: friction in motion; unit: 1/1024 peak
     */
    WRAPTOR_PROPERTY_MFC = 124,
    /*
     motor model: friction at rest; at least MFC counts; unit: 1/1024 peak
     */
    WRAPTOR_PROPERTY_MFS = 125,
    /*
     motor model: electrical time constant; unit: us
     */
    WRAPTOR_PROPERTY_MTE = 126,
    /*
     units of values on the bus: 0 those of this table; 280 those of a BH8-280, for its hosts (decision 0070); nothing between
     */
    WRAPTOR_PROPERTY_HOSTUNITS = 127,
} wraptor_property;

/*
 A value of WRAPTOR_PROPERTY_MODE.
 */
typedef enum wraptor_mode {
    /*
     Bridge off, brake engaged.
     */
    WRAPTOR_MODE_IDLE = 0,
    /*
     Drives with torque T.
     */
    WRAPTOR_MODE_TORQUE = 2,
    /*
     Holds or follows position P.
     */
    WRAPTOR_MODE_PID = 3,
    /*
     Follows velocity V.
     */
    WRAPTOR_MODE_VELOCITY = 4,
    /*
     Moves to E with a trapezoidal velocity profile.
     */
    WRAPTOR_MODE_TRAPEZOIDAL = 5,
} wraptor_mode;

/*
 A connection. Numbers are not used again, and are larger than any file descriptor: read, write and close of POSIX refuse them.
 */
typedef ptrdiff_t wraptor_hand;

/*
 Called some five times a second with how much has been sent to a board. Returns 0 to cancel.
 */
typedef int (*wraptor_on_download)(void *context, int node, int percent);

/*
 The layout of RealTime's blocks, the same for every motor.
 */
typedef struct wraptor_format {
    /*
     Unit of control velocities, hall counts/s, 1 to 255; 0: no velocity in control blocks.
     */
    uint8_t velocity_unit;
    /*
     Not 0: a proportional gain in control blocks.
     */
    uint8_t has_gain;
    /*
     Unit of the velocity fed back, hall counts/s, 1 to 255; 0: none.
     */
    uint8_t feeds_velocity_unit;
    /*
     Not 0: strain in feedback blocks.
     */
    uint8_t feeds_strain;
    /*
     Not 0: position in feedback blocks.
     */
    uint8_t feeds_position;
    /*
     Unit of the change of position fed back, GCL counts, 1 to 255; 0: none.
     */
    uint8_t feeds_change_unit;
    /*
     Not 0: the hand's temperature in feedback blocks.
     */
    uint8_t feeds_temperature;
} wraptor_format;

/*
 What a motor has fed back; 0 for what the format lacks.
 */
typedef struct wraptor_axis {
    /*
     Hall counts/s.
     */
    int32_t velocity;
    /*
     Strain, 0 to 255.
     */
    int32_t strain;
    /*
     GCL counts.
     */
    int32_t position;
    /*
     Change since the last block, GCL counts.
     */
    int32_t change;
} wraptor_axis;

/*
 What a motor is to do.
 */
typedef struct wraptor_control {
    /*
     Hall counts/s, positive closes; rounded and clipped to what a byte of the format's unit holds.
     */
    int32_t velocity;
    /*
     Proportional gain, if the format has it.
     */
    uint8_t gain;
} wraptor_control;

/*
 Called before each block: `block` counts from 0; `axes` has `count` elements with the last feedback, zeros before the first; `temperature` is in °C,
 0 if the format lacks it; `controls` has `count` elements, zeros, for what the motors are to do. Returns 0 to end RealTime.
 */
typedef int (*wraptor_on_block)(void *context,
                                uint64_t block,
                                const struct wraptor_axis *axes,
                                size_t count,
                                double temperature,
                                struct wraptor_control *controls);

/*
 How regular a run was. Arrays hold the median, the 99th percentile and the maximum.
 */
typedef struct wraptor_statistics {
    /*
     Blocks that were answered.
     */
    uint64_t blocks;
    /*
     Places of the schedule that were left out, because an answer had taken longer than a period.
     */
    uint64_t missed;
    /*
     Blocks a second.
     */
    double rate;
    /*
     How late blocks were sent against the schedule, ms.
     */
    double jitter_ms[3];
    /*
     From a block to its whole answer, ms.
     */
    double round_trip_ms[3];
} wraptor_statistics;

/*
 What a thread runs.
 */
typedef uint32_t (*wraptor_thread_function)(void *argument);

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/*
 Cause and next step of the last call of this thread, in English; empty if it succeeded. Valid until this thread's next call.
 */
const char *wraptor_error_text(void);

/*
 The number after ERR that the hand answered to the last call of this thread; 0 if there was none.
 */
int wraptor_error_status(void);

/*
 Nothing to do: sockets of this library start by themselves (the manual's ws_init).
 */
enum wraptor_error wraptor_ws_init(void);

/*
 Closes all connections, and waits until calls of other threads and the threads of `wraptor_start_thread` have ended (the manual's ws_down). A
 connection that another thread is making ends with WRAPTOR_CANCELLED.

 A thread that calls this is not waited for.

 Errors: WRAPTOR_TIMED_OUT if a call or a thread goes on; WRAPTOR_INVALID in a callback.
 */
enum wraptor_error wraptor_ws_down(uint32_t limit_ms);

/*
 Sets the list of property values to zero (the manual's initSoftware).
 */
enum wraptor_error wraptor_init_software(void);

/*
 Connects to a hand over TCP and stores the connection's number in `hand` (the manual's tcp_connect). Boards are neither woken nor asked.

 Errors: WRAPTOR_NOT_CONNECTED, whose text names the cause; WRAPTOR_CANCELLED if wraptor_ws_down was called meanwhile.

 # Safety
 `host` is NULL or a string; `hand` is NULL or may be written.
 */
enum wraptor_error wraptor_tcp_connect(const char *host,
                                       uint16_t port,
                                       wraptor_hand *hand,
                                       uint32_t limit_ms);

/*
 Connects to a hand on a serial port such as `/dev/ttyUSB0` (manual 1.5); its default is 9600 baud. All else is as over TCP. On Windows
 it fails.

 Errors: WRAPTOR_NOT_CONNECTED, whose text names the cause; WRAPTOR_CANCELLED if wraptor_ws_down was called meanwhile.

 # Safety
 `port` is NULL or a string; `hand` is NULL or may be written.
 */
enum wraptor_error wraptor_serial_connect(const char *port,
                                          uint32_t baud,
                                          wraptor_hand *hand,
                                          uint32_t limit_ms);

/*
 Connects to a hand's motor boards by CAN (manual 1.5), without GOD: this library interprets the hand's language itself, and is the bus's one host. `place` is a
 CAN interface of Linux that is up at 1 Mbit/s, such as `can0`, or an SLCAN adapter: `HOST:PORT`, `/dev/ttyACM0`, or `/dev/ttyUSB0@57600` with its baud
 rate. All else is as over TCP, but what is GOD's own: node 0 of wraptor_save_parameters is refused.

 Errors: WRAPTOR_NOT_CONNECTED, whose text names the cause; WRAPTOR_CANCELLED if wraptor_ws_down was called meanwhile.

 # Safety
 `place` is NULL or a string; `hand` is NULL or may be written.
 */
enum wraptor_error wraptor_can_connect(const char *place,
                                       wraptor_hand *hand,
                                       uint32_t limit_ms);

/*
 Closes a connection and frees its thread and its socket. A call of another thread is cancelled and waited for. Motors stop, as after ^C, unless
 characters of `wraptor_tcp_msg` came last, which the hand finishes.

 Errors: WRAPTOR_BAD_HANDLE; WRAPTOR_TIMED_OUT if that call goes on, with which the connection then ends; WRAPTOR_INVALID in a callback of this
 connection.
 */
enum wraptor_error wraptor_close_connection(wraptor_hand hand,
                                            uint32_t limit_ms);

/*
 Cancels the call that another thread runs on this connection: a motion, a wait, RealTime or a download. Does nothing if there is none.

 Errors: WRAPTOR_BAD_HANDLE.
 */
enum wraptor_error wraptor_cancel(wraptor_hand hand);

/*
 Sends `len` characters as they are (the manual's tcp_msg). Lines end with a carriage return; a line that these characters leave without it is
 ended by the next call. Answers are recorded in the list of property values by `wraptor_listener`, `wraptor_delay` or the next call.

 # Safety
 `characters` is NULL or has `len` bytes.
 */
enum wraptor_error wraptor_tcp_msg(wraptor_hand hand,
                                   const char *characters,
                                   size_t len,
                                   uint32_t limit_ms);

/*
 Runs a line of the hand's language. If it sets boards in motion by MODE or CMD, waits until their moves are over (the manual's command).
 The lines that the hand prints go to `answer`, a buffer of `size` bytes or NULL, separated by line feeds and cut to the size.

 Errors: WRAPTOR_STATUS if the hand answers ERR.

 # Safety
 `message` is NULL or a string; `answer` is NULL or has `size` bytes that may be written.
 */
enum wraptor_error wraptor_command(wraptor_hand hand,
                                   const char *message,
                                   char *answer,
                                   size_t size,
                                   uint32_t limit_ms);

/*
 Reads a property of boards (the manual's get) into the list of property values, and into `values`, an array of WRAPTOR_NODES indexed by node,
 or NULL. Elements of other nodes are left as they are.

 Errors: WRAPTOR_NO_ANSWER if boards do not answer.

 # Safety
 `nodes` is NULL or a string; `values` is NULL or has WRAPTOR_NODES elements that may be written.
 */
enum wraptor_error wraptor_get(wraptor_hand hand,
                               const char *nodes,
                               int property,
                               int64_t *values,
                               uint32_t limit_ms);

/*
 Sets a property of boards (the manual's set). WRAPTOR_OK says that the boards have received it: a locked property, or a MODE that a board
 refuses, keeps its value, which `wraptor_get` reads.

 Errors: WRAPTOR_INVALID if the property cannot be set or the value is out of range; WRAPTOR_STATUS with ERR 1 if a board sleeps or is silent.

 # Safety
 `nodes` is NULL or a string.
 */
enum wraptor_error wraptor_set(wraptor_hand hand,
                               const char *nodes,
                               int property,
                               int64_t value,
                               uint32_t limit_ms);

/*
 Waits until a property of all boards has a value (the manual's waitFor). What it reads is recorded in the list of property values. Its limit
 stops no motor.

 # Safety
 `nodes` is NULL or a string.
 */
enum wraptor_error wraptor_wait_for(wraptor_hand hand,
                                    const char *nodes,
                                    int property,
                                    int64_t value,
                                    uint32_t limit_ms);

/*
 Moves fingers to a position of their links in hall counts, with their fingertips (the manual's move), and waits until they are there.

 Errors: WRAPTOR_NOT_REACHED if a motor ends early.

 # Safety
 `fingers` is NULL or a string.
 */
enum wraptor_error wraptor_move(wraptor_hand hand,
                                const char *fingers,
                                int64_t value,
                                uint32_t limit_ms);

/*
 Moves fingers to position zero, with their fingertips (the manual's open), and waits until they are there.

 Errors: WRAPTOR_NOT_REACHED if a motor ends early.

 # Safety
 `fingers` is NULL or a string.
 */
enum wraptor_error wraptor_open(wraptor_hand hand, const char *fingers, uint32_t limit_ms);

/*
 Closes fingers, with their fingertips (the manual's close), and waits until they are closed or an object stops them.

 Errors: WRAPTOR_NOT_REACHED if a fault ends a motion.

 # Safety
 `fingers` is NULL or a string.
 */
enum wraptor_error wraptor_close(wraptor_hand hand,
                                 const char *fingers,
                                 uint32_t limit_ms);

/*
 Finds the stops of boards' motors, sets their positions and moves them to zero (the manual's findZero): links 1 to 3 open first and stay at their
 stops while the spread opens and fingertips 5 to 7 close; links return to zero last. The workspace must be clear.

 # Safety
 `nodes` is NULL or a string.
 */
enum wraptor_error wraptor_find_zero(wraptor_hand hand,
                                     const char *nodes,
                                     uint32_t limit_ms);

/*
 Stores positions and parameters of boards, and with node 0 those of GOD (the manual's saveParameters). Motors should be in mode
 WRAPTOR_MODE_IDLE: only a position at rest is trusted at the next power-on.

 Errors: WRAPTOR_STATUS with ERR 512 if a flash has not taken them.

 # Safety
 `nodes` is NULL or a string.
 */
enum wraptor_error wraptor_save_parameters(wraptor_hand hand,
                                           const char *nodes,
                                           uint32_t limit_ms);

/*
 Wakes all boards (the manual's wakeGrasper), up to 1.5 s. Not before `wraptor_download_firmware`.

 Errors: WRAPTOR_STATUS with ERR 1 if some do not wake.
 */
enum wraptor_error wraptor_wake_grasper(wraptor_hand hand, uint32_t limit_ms);

/*
 Waits, and meanwhile records in the list of property values what all hands send (the manual's delay).
 */
enum wraptor_error wraptor_delay(uint32_t ms);

/*
 Records in the list of property values what a hand sends, until the limit (the manual's Listener). Calls of other threads go first: they
 record too.

 Errors: WRAPTOR_BAD_HANDLE once the connection is closed; WRAPTOR_LOST.
 */
enum wraptor_error wraptor_listener(wraptor_hand hand,
                                    uint32_t limit_ms);

/*
 Finds the hand in the network by a UDP broadcast (the manual's discoverGrasper), listening for the whole limit. `place` is NULL, or an IPv4
 ADDRESS:PORT for questions to it alone, such as the broadcast address of another network, port 30718. Stores the hardware address (`mac`, 18 bytes with
 its zero, empty if the hand does not tell it), the IP address (`address`, 16 bytes) and the port; empty texts and 0 after an error.

 Errors: WRAPTOR_NOT_CONNECTED if no hand answers, or more than one.

 # Safety
 `place` is NULL or a string; `mac` and `address` are NULL or have `mac_size` and `address_size` bytes that may be written; `port` is NULL or may be
 written.
 */
enum wraptor_error wraptor_discover_grasper(const char *place,
                                            char *mac,
                                            size_t mac_size,
                                            char *address,
                                            size_t address_size,
                                            int *port,
                                            uint32_t limit_ms);

/*
 Downloads a `.tek` file to boards, one after the other (the manual's downloadFirmware), and waits until each runs it. `on_download` may be NULL.

 Errors: WRAPTOR_FILE, before anything is sent; WRAPTOR_DOWNLOAD, whose text names the board.

 # Safety
 `nodes` and `file` are NULL or strings; `on_download` is NULL or may be called with `context`.
 */
enum wraptor_error wraptor_download_firmware(wraptor_hand hand,
                                             const char *nodes,
                                             const char *file,
                                             wraptor_on_download on_download,
                                             void *context,
                                             uint32_t limit_ms);

/*
 The list of the last known values of all boards, `list[node][property]` with nodes 1 to 7 (the manual's propertyList). Every function that reads
 a property stores it here, and so does a report that the hand prints unasked. One list for all connections; other threads may change it at
 any time, one value at once.
 */
const long (*wraptor_property_list(void))[WRAPTOR_PROPERTIES];

/*
 Runs RealTime for motors, a prefix of the language such as `124` or `X1234567`, at 1 to 1000 blocks a second, until the callback returns 0. `format`
 is NULL for velocities of unit 8 in and positions out. `limit_ms` bounds the beginning and the end, `block_limit_ms` each block; the callback
 decides how long it runs. `statistics` may be NULL.

 Errors: WRAPTOR_STATUS with ERR 4 before `wraptor_find_zero`.

 # Safety
 `motors` is NULL or a string; `format` is NULL or a format; `on_block` is NULL or may be called with `context`; `statistics` is NULL or may be written.
 */
enum wraptor_error wraptor_realtime(wraptor_hand hand,
                                    const char *motors,
                                    const struct wraptor_format *format,
                                    double rate,
                                    uint32_t block_limit_ms,
                                    wraptor_on_block on_block,
                                    void *context,
                                    struct wraptor_statistics *statistics,
                                    uint32_t limit_ms);

/*
 Starts a thread that runs `function` with `argument`, such as the compatibility header's Listener, and stores its number in `id`, if that is
 not NULL. `wraptor_ws_down` waits for its end.

 # Safety
 `function` is NULL or may be called in another thread with `argument`; `id` is NULL or may be written.
 */
enum wraptor_error wraptor_start_thread(wraptor_thread_function function,
                                        void *argument,
                                        uint32_t *id);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* WRAPTOR_H */
