//! How the program ends, and what it says then.

use std::fmt;

use wraptor::{CallError, ConnectError, Failure};

use crate::interrupt;

/// What ends a script, and a person is told of.
#[derive(Debug)]
pub enum Trouble {
    /// A connection that fails.
    Connect(ConnectError),
    /// A call that fails.
    Call(CallError),
    /// An entry, a file or an argument.
    Input(String),
}

impl Trouble {
    /// 1: the hand or a board reports an error; 2: this program could not do it; 130: ^C.
    pub fn code(&self) -> u8 {
        match self {
            Self::Call(CallError { failure: Failure::Cancelled, .. }) if interrupt::pressed() => {
                interrupt::CODE
            }
            Self::Call(error) => match error.failure {
                Failure::Status(_)
                | Failure::Silent(_)
                | Failure::NotTaken { .. }
                | Failure::NotReached { .. }
                | Failure::Download { .. }
                | Failure::Cancelled => 1,
                _ => 2,
            },
            Self::Connect(_) | Self::Input(_) => 2,
        }
    }

    /// Whether the connection cannot be used any more.
    pub const fn is_lost(&self) -> bool {
        matches!(self, Self::Call(CallError { failure: Failure::Lost(_), .. }))
    }
}

impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Connect(error) => error.fmt(f),
            Self::Call(error) => error.fmt(f),
            Self::Input(text) => f.write_str(text),
        }
    }
}

impl From<ConnectError> for Trouble {
    fn from(error: ConnectError) -> Self {
        Self::Connect(error)
    }
}

impl From<CallError> for Trouble {
    fn from(error: CallError) -> Self {
        Self::Call(error)
    }
}
