//! The power fails at every flash operation, in the middle of it, and again in what follows.

mod storage;
