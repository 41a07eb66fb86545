//! A pseudo-terminal in place of the hand's serial port.

#[cfg(unix)]
pub use unix::open;

#[cfg(unix)]
mod unix {
    use std::fs::File;
    use std::io::{self, Read, Write};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::thread::park_timeout;
    use std::time::Duration;

    use rustix::fs::{Mode, OFlags};
    use rustix::io::Errno;
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use rustix::termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};
    use traces::input::BadInput;

    use super::super::event::bad;
    use super::super::link::Port;

    const POLL: Duration = Duration::from_millis(20);

    struct Pty {
        file: File,
        /// Path of the hosts' side.
        path: String,
        is_open: AtomicBool,
    }

    /// Creates a pseudo-terminal; returns it with its path.
    pub fn open() -> Result<(Arc<dyn Port>, String), BadInput> {
        let failed = |error: Errno| {
            let next = "use --listen";
            bad("--pty".to_owned(), &error.to_string(), "a pseudo-terminal of the system", next)
        };
        let owner = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).map_err(failed)?;
        // Not in the call: macOS has no such flag there.
        rustix::io::fcntl_setfd(&owner, rustix::io::FdFlags::CLOEXEC).map_err(failed)?;
        grantpt(&owner).and_then(|()| unlockpt(&owner)).map_err(failed)?;
        let path = ptsname(&owner, Vec::new()).map_err(failed)?.to_string_lossy().into_owned();
        // Raw mode before a host opens it: no echo, no line editing.
        let mut termios = tcgetattr(&owner).map_err(failed)?;
        termios.make_raw();
        tcsetattr(&owner, OptionalActions::Now, &termios).map_err(failed)?;
        let (file, is_open) = (owner.into(), AtomicBool::new(false));
        Ok((Arc::new(Pty { file, path: path.clone(), is_open }), path))
    }

    impl Port for Pty {
        fn read(&self, bytes: &mut [u8]) -> io::Result<usize> {
            loop {
                let mut file = &self.file;
                match Read::read(&mut file, bytes) {
                    // EIO: no host has it open.
                    Err(error) if Errno::from_io_error(&error) == Some(Errno::IO) => {
                        if self.is_open.swap(false, Ordering::Relaxed) {
                            return Ok(0);
                        }
                        park_timeout(POLL);
                    }
                    Ok(len) => {
                        self.is_open.store(true, Ordering::Relaxed);
                        return Ok(len);
                    }
                    Err(error) => return Err(error),
                }
            }
        }

        fn has_closed(&self) -> bool {
            false
        }

        /// A terminal has no half-closed state: a host that closes it is gone.
        fn wait_for_loss(&self) -> bool {
            true
        }

        fn write(&self, bytes: &[u8]) -> io::Result<()> {
            let mut file = &self.file;
            file.write_all(bytes)
        }

        fn close(&self) {
            // Flush from the hosts' side: bytes that the next host has written already stay. A blocked writer gets room.
            let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
            let _ = rustix::fs::open(&*self.path, flags, Mode::empty())
                .and_then(|hosts| tcflush(hosts, QueueSelector::IFlush));
        }
    }
}

#[cfg(not(unix))]
pub fn open() -> Result<(std::sync::Arc<dyn super::link::Port>, String), traces::input::BadInput> {
    Err(super::event::bad("--pty".to_owned(), "not Unix", "a system with pseudo-terminals", "use --listen"))
}
