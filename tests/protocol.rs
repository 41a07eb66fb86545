//! What is said on the wire and what is downloaded, across crates.

mod tek;
