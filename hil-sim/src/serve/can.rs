//! A CAN interface of Linux (SocketCAN).

#[cfg(target_os = "linux")]
pub use linux::CanPort;
#[cfg(not(target_os = "linux"))]
pub use none::CanPort;

#[cfg(target_os = "linux")]
mod linux {
    use std::io::ErrorKind;
    use std::sync::Arc;
    use std::sync::mpsc::SyncSender;

    use socketcan::{CanFrame, CanSocket, EmbeddedFrame, Frame as _, Socket, StandardId};
    use tater_wire::Frame;
    use traces::input::BadInput;

    use super::super::event::{Event, bad};
    use super::super::tcp::no_thread;
    use crate::thread;
    use programs::output::warn;

    pub struct CanPort {
        socket: Arc<CanSocket>,
        warned: bool,
    }

    impl CanPort {
        /// # Errors
        /// There is no such interface, or the kernel has no CAN.
        pub fn open(interface: &str) -> Result<Self, BadInput> {
            let socket = CanSocket::open(interface).map_err(|error| {
                bad(
                    format!("--can {interface}"),
                    &error.to_string(),
                    "a CAN interface that is up (see `ip link`), in a kernel with CAN_RAW",
                    &format!(
                        "`sudo ip link add dev {interface} type vcan && sudo ip link set {interface} up` makes a virtual one; \
                         without vcan in the kernel, use --slcan"
                    ),
                )
            })?;
            Ok(Self { socket: Arc::new(socket), warned: false })
        }

        /// Reports frames from the interface, in a thread that ends with the interface.
        ///
        /// # Errors
        /// The thread cannot be started.
        pub fn watch(&self, events: SyncSender<Event>) -> Result<(), BadInput> {
            let socket = Arc::clone(&self.socket);
            thread::start(move || {
                loop {
                    let event = match socket.read_frame() {
                        Ok(frame) => match from_interface(&frame) {
                            Some(frame) => Event::Frame(frame),
                            // Boards ignore other kinds of frames.
                            None => continue,
                        },
                        Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                        Err(error) => Event::Lost(format!("the CAN interface failed: {error}")),
                    };
                    let lost = matches!(event, Event::Lost(_));
                    if events.send(event).is_err() || lost {
                        return;
                    }
                }
            })
            .map_err(|error| no_thread("--can", &error))
        }

        pub fn send(&mut self, frame: &Frame) {
            let Some(frame) = to_interface(frame) else { return };
            if let Err(error) = self.socket.write_frame(&frame)
                && !std::mem::replace(&mut self.warned, true)
            {
                warn(&format!("warning: the CAN interface drops frames: {error}"));
            }
        }
    }

    /// The bus carries only data frames with 11-bit identifiers.
    fn from_interface(frame: &CanFrame) -> Option<Frame> {
        match frame {
            CanFrame::Data(data) if !data.is_extended() => {
                Frame::from_raw(u16::try_from(data.raw_id()).ok()?, data.data())
            }
            _ => None,
        }
    }

    fn to_interface(frame: &Frame) -> Option<CanFrame> {
        CanFrame::new(StandardId::new(frame.raw_id())?, frame.data())
    }

    #[cfg(test)]
    mod tests {
        use socketcan::ExtendedId;

        use super::*;

        #[test]
        fn data_frames_convert_both_ways_and_others_are_ignored() {
            for (id, data) in [(0, &[][..]), (0x7FF, &[1, 2, 3, 4, 5, 6, 7, 8]), (0x486, &[0x85, 0, 2, 0])] {
                let frame = Frame::from_raw(id, data).expect("a classic frame");
                let there = to_interface(&frame).expect("the interface takes it");
                assert_eq!(from_interface(&there), Some(frame));
            }
            let extended = ExtendedId::new(4).expect("29 bits");
            assert_eq!(from_interface(&CanFrame::new(extended, &[5]).expect("a frame")), None);
            let standard = StandardId::new(4).expect("11 bits");
            assert_eq!(from_interface(&CanFrame::new_remote(standard, 1).expect("a frame")), None);
        }

        #[test]
        fn missing_interface_is_named_with_the_next_step() {
            let error = CanPort::open("nocan9").err().expect("there is no such interface").to_string();
            assert!(error.contains("--can nocan9") && error.contains("type vcan"), "{error}");
        }
    }
}

#[cfg(not(target_os = "linux"))]
mod none {
    use std::sync::mpsc::SyncSender;

    use tater_wire::Frame;
    use traces::input::BadInput;

    use super::super::event::{Event, bad};

    pub enum CanPort {}

    impl CanPort {
        pub fn open(interface: &str) -> Result<Self, BadInput> {
            Err(bad(
                format!("--can {interface}"),
                "not Linux",
                "Linux, whose kernel has CAN interfaces",
                "use --slcan",
            ))
        }

        pub fn watch(&self, _: SyncSender<Event>) -> Result<(), BadInput> {
            match *self {}
        }

        pub fn send(&mut self, _: &Frame) {
            match *self {}
        }
    }
}
