//! Serial ports and CAN interfaces: files that are waited for together with the end of their connection.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, PipeReader, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::fs::OpenOptionsExt;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;
use rustix::termios::{OptionalActions, ioctl_tiocexcl, tcgetattr, tcsetattr};

use crate::deadline::Deadline;

/// Opens a serial port raw, for this program alone.
pub(super) fn open_tty(path: &str, baud: u32) -> io::Result<File> {
    let flags = OFlags::NONBLOCK | OFlags::NOCTTY;
    let flags = i32::try_from(flags.bits()).map_err(|_| ErrorKind::InvalidInput)?;
    let tty = OpenOptions::new().read(true).write(true).custom_flags(flags).open(path)?;
    let mut termios = tcgetattr(&tty)?;
    termios.make_raw();
    termios.set_speed(baud)?;
    tcsetattr(&tty, OptionalActions::Now, &termios)?;
    ioctl_tiocexcl(&tty)?;
    Ok(tty)
}

/// Waits until the file is ready; `false` at the deadline.
fn wait(file: BorrowedFd, flags: PollFlags, remaining: Duration) -> io::Result<bool> {
    let limit = Timespec::try_from(remaining).map_err(|_| ErrorKind::InvalidInput)?;
    match poll(&mut [PollFd::from_borrowed_fd(file, flags)], Some(&limit)) {
        Ok(ready) => Ok(ready > 0),
        Err(rustix::io::Errno::INTR) => Ok(true),
        Err(error) => Err(error.into()),
    }
}

/// Tries until it succeeds, waiting for room between.
fn until_room(
    file: BorrowedFd,
    deadline: &Deadline,
    mut attempt: impl FnMut() -> io::Result<usize>,
) -> io::Result<usize> {
    loop {
        match attempt() {
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                if deadline.is_over() || !wait(file, PollFlags::OUT, deadline.remaining())? {
                    return Err(ErrorKind::TimedOut.into());
                }
            }
            done => return done,
        }
    }
}

pub(super) fn write(mut tty: &File, bytes: &[u8], deadline: &Deadline) -> io::Result<()> {
    let mut rest = bytes;
    while !rest.is_empty() {
        let written = until_room(tty.as_fd(), deadline, || tty.write(rest))?;
        rest = rest.get(written..).unwrap_or_default();
    }
    Ok(())
}

/// Waits until the file has something to read, or `dropped` ends; `false` then.
pub(super) fn is_readable(file: BorrowedFd, dropped: &PipeReader) -> io::Result<bool> {
    let mut files = [PollFd::from_borrowed_fd(file, PollFlags::IN), PollFd::new(dropped, PollFlags::IN)];
    poll(&mut files, None)?;
    Ok(files[1].revents().is_empty())
}

/// The next frame; `None` for one that is no data frame with an 11-bit identifier, which this bus does not carry.
#[cfg(target_os = "linux")]
pub(super) fn frame(socket: &socketcan::CanSocket) -> io::Result<Option<tater_wire::Frame>> {
    use socketcan::{CanFrame, EmbeddedFrame, Frame as _, Socket};
    Ok(match socket.read_frame()? {
        CanFrame::Data(data) if !data.is_extended() => {
            u16::try_from(data.raw_id()).ok().and_then(|id| tater_wire::Frame::from_raw(id, data.data()))
        }
        _ => None,
    })
}

#[cfg(target_os = "linux")]
pub(super) fn send(
    socket: &socketcan::CanSocket,
    frame: &tater_wire::Frame,
    deadline: &Deadline,
) -> io::Result<()> {
    use socketcan::{CanFrame, EmbeddedFrame, Socket, StandardId};
    let frame = StandardId::new(frame.raw_id()).and_then(|id| CanFrame::new(id, frame.data()));
    let frame = frame.ok_or(ErrorKind::InvalidInput)?;
    until_room(socket.as_fd(), deadline, || socket.write_frame(&frame).map(|()| 0)).map(|_| ())
}
