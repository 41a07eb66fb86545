//! Results of the tools.

/// Result of a tool: nothing, or an error text for the user.
pub type Outcome = Result<(), String>;

/// Why a tool failed, as a text for the user; the variant determines the exit code.
pub enum Failure {
    /// A check failed: exit code 1.
    Judged(String),
    /// The check could not run, or the arguments are wrong: exit code 2.
    Unusable(String),
}

impl From<String> for Failure {
    fn from(message: String) -> Self {
        Self::Judged(message)
    }
}

impl From<Failure> for String {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::Judged(message) | Failure::Unusable(message) => message,
        }
    }
}
