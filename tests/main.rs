//! System tests: one binary, a module a subject.

mod fences;
mod plant;
mod profile;
mod scenarios;
