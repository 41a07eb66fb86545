//! The GDB remote protocol: stops and steps the program, while the motor keeps the program's time.
//!
//! Registers, memory, breakpoints, step, continue and ^C. The bus stands still while the program is stopped.

use std::net::{Ipv4Addr, TcpListener, TcpStream};

use gdbstub::arch::{Arch, Registers};
use gdbstub::common::Signal;
use gdbstub::conn::ConnectionExt;
use gdbstub::stub::SingleThreadStopReason;
use gdbstub::stub::state_machine::GdbStubStateMachine;
use gdbstub::stub::{GdbStub, GdbStubError};
use gdbstub::target::ext::base::BaseOps;
use gdbstub::target::ext::base::singlethread::{
    SingleThreadBase, SingleThreadResume, SingleThreadResumeOps, SingleThreadSingleStep,
    SingleThreadSingleStepOps,
};
use gdbstub::target::ext::breakpoints::{Breakpoints, BreakpointsOps, SwBreakpoint, SwBreakpointOps};
use gdbstub::target::{Target, TargetError, TargetResult};

use crate::board::{Board, DebugRequests};
use crate::chip::Size;
use crate::time::{Time, US};

/// Longest run between two checks for ^C.
const SLICE: Time = 1000 * US;

/// The architecture for GDB: registers of its feature `org.gnu.gdb.arm.m-profile`.
pub enum CortexM {}

/// r0 to r12, sp, lr, pc, xPSR.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Core([u32; 17]);

impl Registers for Core {
    type ProgramCounter = u32;

    fn pc(&self) -> u32 {
        self.0[15]
    }

    fn gdb_serialize(&self, mut write_byte: impl FnMut(Option<u8>)) {
        self.0.iter().flat_map(|word| word.to_le_bytes()).for_each(|byte| write_byte(Some(byte)));
    }

    fn gdb_deserialize(&mut self, bytes: &[u8]) -> Result<(), ()> {
        let words = bytes.as_chunks::<4>().0;
        if words.len() != self.0.len() {
            return Err(());
        }
        for (register, word) in self.0.iter_mut().zip(words) {
            *register = u32::from_le_bytes(*word);
        }
        Ok(())
    }
}

impl Arch for CortexM {
    type Usize = u32;
    type Registers = Core;
    type RegId = ();
    type BreakpointKind = usize;

    fn target_description_xml() -> Option<&'static str> {
        Some(concat!(
            r#"<?xml version="1.0"?><!DOCTYPE target SYSTEM "gdb-target.dtd"><target version="1.0">"#,
            r#"<architecture>arm</architecture><feature name="org.gnu.gdb.arm.m-profile">"#,
            r#"<reg name="r0" bitsize="32"/><reg name="r1" bitsize="32"/><reg name="r2" bitsize="32"/>"#,
            r#"<reg name="r3" bitsize="32"/><reg name="r4" bitsize="32"/><reg name="r5" bitsize="32"/>"#,
            r#"<reg name="r6" bitsize="32"/><reg name="r7" bitsize="32"/><reg name="r8" bitsize="32"/>"#,
            r#"<reg name="r9" bitsize="32"/><reg name="r10" bitsize="32"/><reg name="r11" bitsize="32"/>"#,
            r#"<reg name="r12" bitsize="32"/><reg name="sp" bitsize="32" type="data_ptr"/>"#,
            r#"<reg name="lr" bitsize="32"/><reg name="pc" bitsize="32" type="code_ptr"/>"#,
            r#"<reg name="xpsr" bitsize="32" regnum="25"/></feature></target>"#
        ))
    }
}

impl Target for Board {
    type Arch = CortexM;
    type Error = std::convert::Infallible;

    fn base_ops(&mut self) -> BaseOps<'_, CortexM, Self::Error> {
        BaseOps::SingleThread(self)
    }

    fn support_breakpoints(&mut self) -> Option<BreakpointsOps<'_, Self>> {
        Some(self)
    }
}

impl SingleThreadBase for Board {
    fn read_registers(&mut self, registers: &mut Core) -> TargetResult<(), Self> {
        for (index, register) in registers.0.iter_mut().enumerate() {
            *register = self.machine().cpu.register(index);
        }
        Ok(())
    }

    fn write_registers(&mut self, registers: &Core) -> TargetResult<(), Self> {
        for (index, &register) in registers.0.iter().enumerate() {
            self.machine_mut().cpu.set_register(index, register);
        }
        Ok(())
    }

    /// Memory only: reading a register may change it.
    fn read_addrs(&mut self, start: u32, data: &mut [u8]) -> TargetResult<usize, Self> {
        let chip = self.machine_mut().chip_mut();
        for (done, byte) in data.iter_mut().enumerate() {
            let address = start.wrapping_add(done as u32);
            let is_memory = address < 0x4000_0000;
            match chip.read(address, Size::Byte).ok().filter(|_| is_memory) {
                Some(read) => *byte = read as u8,
                None if done == 0 => return Err(TargetError::NonFatal),
                None => return Ok(done),
            }
        }
        Ok(data.len())
    }

    /// RAM only.
    fn write_addrs(&mut self, start: u32, data: &[u8]) -> TargetResult<(), Self> {
        let chip = self.machine_mut().chip_mut();
        for (address, &byte) in (start..).zip(data) {
            if !(0x2000_0000..0x2000_5000).contains(&address) {
                return Err(TargetError::NonFatal);
            }
            chip.write(address, Size::Byte, byte.into()).map_err(|_| TargetError::NonFatal)?;
        }
        Ok(())
    }

    fn support_resume(&mut self) -> Option<SingleThreadResumeOps<'_, Self>> {
        Some(self)
    }
}

impl SingleThreadResume for Board {
    fn resume(&mut self, _signal: Option<Signal>) -> Result<(), Self::Error> {
        self.debug.step = false;
        Ok(())
    }

    fn support_single_step(&mut self) -> Option<SingleThreadSingleStepOps<'_, Self>> {
        Some(self)
    }
}

impl SingleThreadSingleStep for Board {
    fn step(&mut self, _signal: Option<Signal>) -> Result<(), Self::Error> {
        self.debug.step = true;
        Ok(())
    }
}

impl Breakpoints for Board {
    fn support_sw_breakpoint(&mut self) -> Option<SwBreakpointOps<'_, Self>> {
        Some(self)
    }
}

/// The program is not modified: the board compares the program counter.
impl SwBreakpoint for Board {
    fn add_sw_breakpoint(&mut self, address: u32, _kind: usize) -> TargetResult<bool, Self> {
        self.debug.breakpoints.push(address);
        Ok(true)
    }

    fn remove_sw_breakpoint(&mut self, address: u32, _kind: usize) -> TargetResult<bool, Self> {
        let found = self.debug.breakpoints.iter().position(|&at| at == address);
        Ok(found.map(|index| self.debug.breakpoints.swap_remove(index)).is_some())
    }
}

/// A connected GDB, which runs a board.
pub struct Server {
    /// `None` after a disconnect.
    stub: Option<GdbStubStateMachine<'static, Board, TcpStream>>,
    /// GDB knows that the board has stopped for good.
    told: bool,
}

/// Listens on a port of localhost; 0 for any.
///
/// # Errors
/// The port is in use.
pub fn listen(port: u16) -> Result<TcpListener, String> {
    TcpListener::bind((Ipv4Addr::LOCALHOST, port))
        .map_err(|error| format!("--gdb {port}: {error}\n  next: give another port"))
}

impl Server {
    /// Waits for a GDB, which finds the board stopped.
    ///
    /// # Errors
    /// The connection fails.
    pub fn accept(listener: &TcpListener, board: &mut Board) -> Result<Self, String> {
        let (stream, _) = listener.accept().map_err(|error| format!("--gdb: {error}"))?;
        // GDB waits for each small packet.
        wraptor::configure_tcp(&stream).map_err(|error| format!("--gdb: {error}"))?;
        let stub =
            GdbStub::new(stream).run_state_machine(board).map_err(|error| format!("--gdb: {error}"))?;
        Ok(Self { stub: Some(stub), told: false })
    }

    /// Runs the board up to `until` as GDB requests; blocks while it is stopped.
    pub fn run(&mut self, board: &mut Board, until: Time) {
        while let Some(stub) = self.stub.take() {
            let next = match stub {
                GdbStubStateMachine::Idle(mut stub) => match stub.borrow_conn().read() {
                    Ok(byte) => stub.incoming_data(board, byte),
                    Err(_) => break,
                },
                GdbStubStateMachine::CtrlCInterrupt(stub) => {
                    stub.interrupt_handled(board, Some(SingleThreadStopReason::Signal(Signal::SIGINT)))
                }
                GdbStubStateMachine::Disconnected(_) => break,
                GdbStubStateMachine::Running(mut stub) => {
                    if board.machine().now() >= until {
                        self.stub = Some(stub.into());
                        return;
                    }
                    match stub.borrow_conn().peek() {
                        Ok(Some(_)) => match stub.borrow_conn().read() {
                            Ok(byte) => stub.incoming_data(board, byte),
                            Err(_) => break,
                        },
                        Ok(None) => match self.go_on(board, until) {
                            Some(reason) => stub.report_stop(board, reason),
                            None => Ok(stub.into()),
                        },
                        Err(_) => break,
                    }
                }
            };
            self.stub = keep(next);
        }
        // GDB has disconnected: run on without it.
        board.debug = DebugRequests::default();
        board.run(until, &[]);
    }

    fn go_on(&mut self, board: &mut Board, until: Time) -> Option<SingleThreadStopReason<u32>> {
        let breakpoints = board.debug.breakpoints.clone();
        let reason = if board.debug.step {
            step(board, until).then_some(SingleThreadStopReason::DoneStep)
        } else {
            let slice = until.min(board.machine().now() + SLICE);
            board.run(slice, &breakpoints).then_some(SingleThreadStopReason::SwBreak(()))
        };
        if board.problem().is_some() && !std::mem::replace(&mut self.told, true) {
            return Some(SingleThreadStopReason::Signal(Signal::SIGABRT));
        }
        reason
    }
}

/// Returns `false` if the core sleeps until `until`.
fn step(board: &mut Board, until: Time) -> bool {
    let before = board.machine().cpu.counts.instructions;
    while board.machine().now() < until && board.problem().is_none() {
        let machine = board.machine();
        let now = machine.now();
        let to = if machine.is_waiting() { machine.next_event().clamp(now + 1, until) } else { now + 1 };
        board.run(to, &[]);
        if board.machine().cpu.counts.instructions != before {
            return true;
        }
    }
    false
}

fn keep<E, C>(
    next: Result<GdbStubStateMachine<'static, Board, TcpStream>, GdbStubError<E, C>>,
) -> Option<GdbStubStateMachine<'static, Board, TcpStream>> {
    next.ok()
}
