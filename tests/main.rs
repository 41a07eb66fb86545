//! System tests: one binary, a module a subject.

mod fences;
mod loops;
mod plant;
mod profile;
