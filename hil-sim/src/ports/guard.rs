//! ^C to the hand when the console is killed (^C, the end of its terminal, `kill -9`).
//!
//! TCP tells the hand only that its host sends nothing more, and the hand then finishes what it has begun (decision 0031). A handler of
//! signals needs unsafe code, and none sees `kill -9`. So another process has the connection too. It is in a process group of its own, which
//! the terminal's signals do not reach, and notices by the end of a pipe that the console is gone.

#[cfg(unix)]
pub use unix::{Guard, guard};

#[cfg(unix)]
mod unix {
    use std::io::{self, Read, Write};
    use std::net::TcpStream;
    use std::os::fd::{AsFd, OwnedFd};
    use std::os::unix::process::CommandExt;
    use std::process::{Child, Command, Stdio};
    use std::sync::mpsc::sync_channel;
    use std::time::Duration;

    use crate::ports::thread;
    use god::io::ABORT;

    /// Longest wait for the prompt after ^C.
    const PROMPT_LIMIT: Duration = Duration::from_secs(1);

    /// The guarding process; dropping it, at an orderly end of the console, ends it without a ^C.
    pub struct Guard(Child);

    impl Guard {
        /// # Errors
        /// The process cannot be started.
        pub fn new(hand: &TcpStream) -> io::Result<Self> {
            let hand = OwnedFd::from(hand.try_clone()?);
            let mut command = Command::new(std::env::current_exe()?);
            command.args(["grasper", "--guard"]).process_group(0);
            command.stdin(Stdio::piped()).stdout(hand).stderr(Stdio::null());
            command.spawn().map(Self)
        }
    }

    impl Drop for Guard {
        fn drop(&mut self) {
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }

    /// The guarding process: standard input ends with the console, and standard output is the connection.
    ///
    /// # Errors
    /// The connection is lost.
    pub fn guard() -> io::Result<()> {
        io::copy(&mut io::stdin(), &mut io::sink())?;
        let mut hand = TcpStream::from(io::stdout().as_fd().try_clone_to_owned()?);
        hand.write_all(&[ABORT])?;
        let (done, prompted) = sync_channel(1);
        thread::start(move || {
            let (mut last, mut byte) = ([0; 3], [0]);
            while last != *b"=> " && hand.read(&mut byte).is_ok_and(|len| len > 0) {
                last = [last[1], last[2], byte[0]];
            }
            let _ = done.send(());
        })?;
        let _ = prompted.recv_timeout(PROMPT_LIMIT);
        Ok(())
    }
}

#[cfg(not(unix))]
pub struct Guard;

#[cfg(not(unix))]
impl Guard {
    pub fn new(_: &std::net::TcpStream) -> std::io::Result<Self> {
        Ok(Self)
    }
}

#[cfg(not(unix))]
pub fn guard() -> std::io::Result<()> {
    Ok(())
}
