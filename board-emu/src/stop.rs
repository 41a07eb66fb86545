//! Problems that end a run: misuse that no board survives, and accesses that are not modeled.

use std::fmt;

/// Kind of problem.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Problem {
    /// A register, bit or access width that the chip model lacks.
    NotModeled {
        /// Address of the access.
        address: u32,
        /// Written value, or `None` for a read.
        value: Option<u32>,
        /// Explanation.
        what: String,
    },
    /// An instruction that the core lacks.
    Instruction {
        /// Its bits; a narrow one in the lower 16.
        code: u32,
        /// Explanation.
        what: String,
    },
    /// A fault that cannot be taken (ARMv7-M B1.5.15).
    Lockup {
        /// Explanation.
        what: String,
    },
    /// The stack pointer has left the stack.
    Stack {
        /// The pointer.
        pointer: u32,
    },
    /// Shoot-through, or an undriven gate while the bridge is on.
    Bridge {
        /// Leg or gate, with an explanation.
        what: String,
    },
}

/// A problem with its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stop {
    /// The problem.
    pub problem: Problem,
    /// Address of the instruction.
    pub pc: u32,
    /// Its function, if the program's names are known.
    pub function: Option<String>,
    /// Time, us.
    pub at_us: u64,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotModeled { address, value: None, what } => {
                write!(f, "read of {address:#010x}, which is not modeled: {what}")
            }
            Self::NotModeled { address, value: Some(value), what } => {
                write!(f, "write of {value:#x} to {address:#010x}, which is not modeled: {what}")
            }
            Self::Instruction { code, what } => write!(f, "instruction {code:#x}: {what}"),
            Self::Lockup { what } => write!(f, "the processor locks up: {what}"),
            Self::Stack { pointer } => write!(f, "the stack pointer is {pointer:#010x}, outside the stack"),
            Self::Bridge { what } => write!(f, "bridge: {what}"),
        }
    }
}

impl fmt::Display for Stop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { problem, pc, function, at_us } = self;
        write!(f, "{problem}, at {pc:#010x}")?;
        if let Some(function) = function {
            write!(f, " in {function}")?;
        }
        write!(f, ", {at_us} us after power-up")
    }
}

impl std::error::Error for Stop {}
