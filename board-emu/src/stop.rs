//! Why a run ends that should not have: what the program or the bridge did that no board survives, or that is not modelled.

use std::fmt;

/// What went wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Problem {
    /// A register, a bit or a width of access that the model of the chip does not have.
    NotModelled {
        /// Where.
        address: u32,
        /// Written, or `None` for a read.
        value: Option<u32>,
        /// What of it.
        what: String,
    },
    /// An instruction that the core does not know.
    Instruction {
        /// Its bits; a narrow one in the lower 16.
        code: u32,
        /// What of it.
        what: String,
    },
    /// A fault that cannot be taken (ARMv7-M B1.5.15).
    Lockup {
        /// Why.
        what: String,
    },
    /// The stack pointer left the stack.
    Stack {
        /// Where it is.
        pointer: u32,
    },
    /// Both switches of a leg conduct, or nobody says what a gate is to do while the bridge is on.
    Bridge {
        /// Which, and why.
        what: String,
    },
}

/// A problem with its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stop {
    /// What went wrong.
    pub problem: Problem,
    /// Address of the instruction.
    pub pc: u32,
    /// The function that it is in, if the program's names are known.
    pub function: Option<String>,
    /// When, us.
    pub at_us: u64,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotModelled { address, value: None, what } => {
                write!(f, "read of {address:#010x}, which is not modelled: {what}")
            }
            Self::NotModelled { address, value: Some(value), what } => {
                write!(f, "write of {value:#x} to {address:#010x}, which is not modelled: {what}")
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
