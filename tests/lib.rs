//! Nothing: this package only holds the system tests.
