//! How the program ends, and what it says then.

use std::fmt;

use wraptor::{CallError, ConnectError, Failure};

use programs::interrupt;

/// What ends a script, and a person is told of.
#[derive(Debug)]
pub enum Trouble {
    /// A connection that fails.
    Connect(ConnectError),
    /// A call that fails.
    Call(CallError),
    /// The same, with what the hand's number does not tell: a cause and perhaps its own next step.
    Explained(CallError, String),
    /// An entry, a file or an argument.
    Input(String),
    /// What ended a script, and where.
    Script(String, Box<Self>),
}

impl Trouble {
    /// 1: the hand or a board reports an error; 2: this program could not do it; 130: ^C.
    pub fn code(&self) -> u8 {
        match self {
            Self::Call(CallError { failure: Failure::Cancelled, .. }) if interrupt::interrupted() => {
                interrupt::CODE
            }
            Self::Call(error) | Self::Explained(error, _) => match error.failure {
                Failure::Status(_)
                | Failure::Silent(_)
                | Failure::Asleep(_)
                | Failure::NotTaken { .. }
                | Failure::NotReached { .. }
                | Failure::Download { .. }
                | Failure::Cancelled => 1,
                _ => 2,
            },
            Self::Connect(_) | Self::Input(_) => 2,
            Self::Script(_, trouble) => trouble.code(),
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
            Self::Explained(error, hint) if hint.contains("next: ") => {
                write!(f, "{}: {}: {hint}", error.call, error.failure)
            }
            Self::Explained(error, hint) => {
                write!(f, "{}: {}: {hint}\n  next: {}", error.call, error.failure, error.failure.next_step())
            }
            Self::Input(text) => f.write_str(text),
            Self::Script(place, trouble) => write!(f, "{place}{trouble}"),
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
