#ifndef WRAPTOR_COMPAT_H
#define WRAPTOR_COMPAT_H

/*
 The names, signatures and endless waits of the manual's section 7, over wraptor.h. C99 and C++17, POSIX.

 A function without a return value prints its error to standard error; wraptor_error_text() has it too.

 `open` and `close` are functions of POSIX as well. In C++ both overload. In C they are macros here, and (open)(path, flags) and (close)(file) are the
 functions of POSIX; include this header after those that you need besides.
 */

/* The headers that declare what is replaced here come first. */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "wraptor.h"

/* Windows' names, as the manual uses them. A SOCKET fits a pointer, since it is passed to a thread as one. */
typedef wraptor_hand SOCKET;
typedef uint32_t DWORD;
#define WINAPI

/* Names of properties and modes. */
#define MOTOR_TEMPERATURE WRAPTOR_PROPERTY_TEMP
#define TRAP_END_POSITION WRAPTOR_PROPERTY_E
#define CONTROL_MODE WRAPTOR_PROPERTY_MODE
#define MODE_IDLE WRAPTOR_MODE_IDLE
#define MODE_TORQUE WRAPTOR_MODE_TORQUE
#define MODE_PID WRAPTOR_MODE_PID
#define MODE_VELOCITY WRAPTOR_MODE_VELOCITY
#define MODE_TRAPEZOIDAL WRAPTOR_MODE_TRAPEZOIDAL

/* The last known values, propertyList[node][property], nodes 1 to 7. */
#define propertyList (wraptor_property_list())

/* Where discoverGrasper asks: NULL for the network of the default route and this machine, or "ADDRESS:PORT" for another network's broadcast address. */
#ifndef WRAPTOR_COMPAT_PLACE
#define WRAPTOR_COMPAT_PLACE NULL
#endif

/* Limits of what does not wait endlessly, ms: to connect, to listen for a hand, to close. */
#define WRAPTOR_COMPAT_CONNECT_MS 10000
#define WRAPTOR_COMPAT_DISCOVER_MS 1000
#define WRAPTOR_COMPAT_CLOSE_MS 5000

/* Pause before boards that did not answer are asked again, ms. */
#define WRAPTOR_COMPAT_AGAIN_MS 20

static inline enum wraptor_error wraptor_compat_checked(enum wraptor_error error)
{
    if (error != WRAPTOR_OK) {
        fprintf(stderr, "%s\n", wraptor_error_text());
    }
    return error;
}

#ifdef __cplusplus
#define WRAPTOR_COMPAT_OPEN open
#define WRAPTOR_COMPAT_CLOSE close
#else
#define WRAPTOR_COMPAT_OPEN wraptor_compat_open
#define WRAPTOR_COMPAT_CLOSE wraptor_compat_close
#endif

static inline void WRAPTOR_COMPAT_OPEN(SOCKET g, const char *nodes)
{
    wraptor_compat_checked(wraptor_open(g, nodes, WRAPTOR_ENDLESS));
}

static inline void WRAPTOR_COMPAT_CLOSE(SOCKET g, const char *nodes)
{
    wraptor_compat_checked(wraptor_close(g, nodes, WRAPTOR_ENDLESS));
}

#if defined(__cplusplus) && defined(__LP64__)
/* A SOCKET is no file: closesocket closes it. */
int close(SOCKET) = delete;
#endif

#ifndef __cplusplus
#define open(g, nodes) wraptor_compat_open(g, nodes)
#define close(g, nodes) wraptor_compat_close(g, nodes)
#endif

static inline void command(SOCKET g, const char *message)
{
    wraptor_compat_checked(wraptor_command(g, message, NULL, 0, WRAPTOR_ENDLESS));
}

static inline void delay(DWORD ms)
{
    wraptor_compat_checked(wraptor_delay(ms));
}

/* Writes at most 18 bytes to mac and 16 to ipaddress. Returns 0, or a number of enum wraptor_error. */
static inline int discoverGrasper(char mac[], char ipaddress[], int *port)
{
    return (int)wraptor_compat_checked(wraptor_discover_grasper(
        WRAPTOR_COMPAT_PLACE, mac, 18, ipaddress, 16, port, WRAPTOR_COMPAT_DISCOVER_MS));
}

static inline int wraptor_compat_percent(void *context, int node, int percent)
{
    (void)context;
    printf("\rNode %d: %3d %%", node, percent);
    fflush(stdout);
    return 1;
}

/* Returns 0, or a number of enum wraptor_error. */
static inline int downloadFirmware(SOCKET g, const char *nodes, const char *fname)
{
    enum wraptor_error error =
        wraptor_download_firmware(g, nodes, fname, wraptor_compat_percent, NULL, WRAPTOR_ENDLESS);
    printf("\n");
    return (int)wraptor_compat_checked(error);
}

static inline void findZero(SOCKET g, const char *nodes)
{
    wraptor_compat_checked(wraptor_find_zero(g, nodes, WRAPTOR_ENDLESS));
}

/* Boards that do not answer are asked again until they do. */
static inline void get(SOCKET g, const char *nodes, int property)
{
    enum wraptor_error error;
    while ((error = wraptor_get(g, nodes, property, NULL, WRAPTOR_ENDLESS)) == WRAPTOR_NO_ANSWER) {
        wraptor_delay(WRAPTOR_COMPAT_AGAIN_MS);
    }
    wraptor_compat_checked(error);
}

static inline void initSoftware(void)
{
    wraptor_compat_checked(wraptor_init_software());
}

/* Ends with its connection. */
static inline DWORD WINAPI Listener(void *g)
{
    enum wraptor_error error = wraptor_listener((SOCKET)g, WRAPTOR_ENDLESS);
    if (error != WRAPTOR_BAD_HANDLE) {
        wraptor_compat_checked(error);
    }
    return 0;
}

static inline void move(SOCKET g, const char *nodes, long value)
{
    wraptor_compat_checked(wraptor_move(g, nodes, value, WRAPTOR_ENDLESS));
}

static inline void saveParameters(SOCKET g, const char *nodes)
{
    wraptor_compat_checked(wraptor_save_parameters(g, nodes, WRAPTOR_ENDLESS));
}

static inline void set(SOCKET g, const char *nodes, int property, long value)
{
    wraptor_compat_checked(wraptor_set(g, nodes, property, value, WRAPTOR_ENDLESS));
}

/* Returns -1 if no connection is made. */
static inline SOCKET tcp_connect(const char *hostname, unsigned short portnum)
{
    SOCKET g = -1;
    wraptor_compat_checked(wraptor_tcp_connect(hostname, portnum, &g, WRAPTOR_COMPAT_CONNECT_MS));
    return g;
}

/* The same on a serial port such as "/dev/ttyUSB0", usually at 9600 baud. Not in the manual: its 1.5 names this way, its section 7 has no function for it. */
static inline SOCKET serial_connect(const char *port, DWORD baud)
{
    SOCKET g = -1;
    wraptor_compat_checked(wraptor_serial_connect(port, baud, &g, WRAPTOR_COMPAT_CONNECT_MS));
    return g;
}

/* The same by CAN, on an interface such as "can0" or an SLCAN adapter, "HOST:PORT" or "/dev/ttyACM0". Not in the manual, as above. */
static inline SOCKET can_connect(const char *place)
{
    SOCKET g = -1;
    wraptor_compat_checked(wraptor_can_connect(place, &g, WRAPTOR_COMPAT_CONNECT_MS));
    return g;
}

/* Returns sd, or -1 if the characters were not taken. */
static inline SOCKET tcp_msg(SOCKET sd, const char *buff, int len)
{
    enum wraptor_error error;
    if (len < 0) {
        return -1;
    }
    error = wraptor_tcp_msg(sd, buff, (size_t)len, WRAPTOR_ENDLESS);
    return wraptor_compat_checked(error) == WRAPTOR_OK ? sd : -1;
}

/* Boards that do not answer are asked again until they do. */
static inline void waitFor(SOCKET g, const char *nodes, int property, long value)
{
    enum wraptor_error error;
    while ((error = wraptor_wait_for(g, nodes, property, value, WRAPTOR_ENDLESS)) == WRAPTOR_NO_ANSWER) {
        wraptor_delay(WRAPTOR_COMPAT_AGAIN_MS);
    }
    wraptor_compat_checked(error);
}

static inline void wakeGrasper(SOCKET g)
{
    wraptor_compat_checked(wraptor_wake_grasper(g, WRAPTOR_ENDLESS));
}

/* Closes all connections, and ends the threads of Listener. Returns 0, or a number of enum wraptor_error. */
static inline int ws_down(void)
{
    return wraptor_compat_checked(wraptor_ws_down(WRAPTOR_COMPAT_CLOSE_MS));
}

/* Returns 0. */
static inline int ws_init(void)
{
    return wraptor_compat_checked(wraptor_ws_init());
}

/* What the manual's examples use of Windows. Only the function, its argument and the place for its number count; returns NULL if there is no thread. */
static inline void *CreateThread(
    void *security, size_t stack, DWORD(WINAPI *function)(void *), void *argument, DWORD flags, DWORD *id)
{
    static char started;
    (void)security;
    (void)stack;
    (void)flags;
    return wraptor_compat_checked(wraptor_start_thread(function, argument, id)) == WRAPTOR_OK ? &started : NULL;
}

/*
 A bounded gets: takes an array, and of a line what has room in it. The rest of the line is dropped. Returns NULL at the end of the input, and for a
 pointer, whose size is unknown.
 */
static inline char *wraptor_compat_gets(char *buffer, const void *place, size_t size)
{
    size_t length = 0;
    int character;
    if ((const void *)buffer != place || size == 0) {
        fprintf(stderr, "gets: expected an array, such as char name[127]\n");
        return NULL;
    }
    while ((character = getchar()) != EOF && character != '\n') {
        if (length + 1 < size) {
            buffer[length++] = (char)character;
        }
    }
    buffer[length] = '\0';
    return character == EOF && length == 0 ? NULL : buffer;
}

#undef gets
#define gets(buffer) wraptor_compat_gets((buffer), &(buffer), sizeof(buffer))

#endif
