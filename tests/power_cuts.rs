//! Power cuts at every flash operation: what is stored and what is downloaded is afterwards old or new.

mod image;
mod monitor;
mod storage;
