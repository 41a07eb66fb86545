//! A classic CAN data frame: an 11-bit identifier and up to eight data bytes. The protocol has no remote frames and no
//! extended identifiers.

use crate::id::{Destination, Identifier, Node};

/// A classic CAN data frame, also as [`embedded_can::Frame`] for any driver with that trait.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    id: u16,
    len: u8,
    /// Zero from `len` on, so that equal frames are equal.
    bytes: [u8; 8],
}

impl Frame {
    /// From the host to itself, without data: a placeholder with no meaning.
    pub const EMPTY: Self = Self { id: 0, len: 0, bytes: [0; 8] };

    /// A frame with this data; `None` for more than eight bytes.
    #[must_use]
    pub fn new(id: Identifier, data: &[u8]) -> Option<Self> {
        let mut bytes = [0; 8];
        bytes.get_mut(..data.len())?.copy_from_slice(data);
        Some(Self { id: id.raw(), len: u8::try_from(data.len()).ok()?, bytes })
    }

    /// From a CAN controller's registers; `None` for an identifier above 0x7FF or more than eight bytes.
    #[must_use]
    pub fn from_raw(id: u16, data: &[u8]) -> Option<Self> {
        Self::new(Identifier::from_raw(id)?, data)
    }

    /// The 11 bits of the identifier, which are also the frame's priority: the lowest wins the arbitration.
    #[must_use]
    pub const fn raw_id(&self) -> u16 {
        self.id
    }

    /// The identifier.
    #[must_use]
    pub fn id(&self) -> Identifier {
        Identifier::from_raw(self.id & 0x7FF)
            .unwrap_or(Identifier { from: Node::HOST, to: Destination::Node(Node::HOST) })
    }

    /// The data, 0 to 8 bytes.
    #[must_use]
    pub fn data(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.len)).unwrap_or(&[])
    }
}

impl embedded_can::Frame for Frame {
    fn new(id: impl Into<embedded_can::Id>, data: &[u8]) -> Option<Self> {
        match id.into() {
            embedded_can::Id::Standard(id) => Self::from_raw(id.as_raw(), data),
            embedded_can::Id::Extended(_) => None,
        }
    }

    /// Always `None`: the protocol has no remote frames.
    fn new_remote(_: impl Into<embedded_can::Id>, _: usize) -> Option<Self> {
        None
    }

    fn is_extended(&self) -> bool {
        false
    }

    fn is_remote_frame(&self) -> bool {
        false
    }

    fn id(&self) -> embedded_can::Id {
        // 11 bits by construction.
        embedded_can::StandardId::new(self.id & 0x7FF).unwrap_or(embedded_can::StandardId::ZERO).into()
    }

    fn dlc(&self) -> usize {
        self.data().len()
    }

    fn data(&self) -> &[u8] {
        Self::data(self)
    }
}

impl core::fmt::Debug for Frame {
    /// In candump's notation: `406#80020000`.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{:03X}#", self.id)?;
        for byte in self.data() {
            write!(f, "{byte:02X}")?;
        }
        Ok(())
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for Frame {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "{=u16:03X}#{=[u8]:02x}", self.id, self.data());
    }
}

#[cfg(test)]
mod tests {
    use super::Frame;
    use embedded_can::{ExtendedId, Frame as _, Id, StandardId};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn embedded_can_frame_round_trips(id in 0..=0x7FF_u16, data in prop::collection::vec(any::<u8>(), 0..=8)) {
            let id = StandardId::new(id).expect("11 bits");
            let frame = <Frame as embedded_can::Frame>::new(id, &data).expect("up to eight bytes");
            let read = (embedded_can::Frame::id(&frame), frame.dlc(), embedded_can::Frame::data(&frame));
            prop_assert_eq!(read, (Id::Standard(id), data.len(), &data[..]));
            prop_assert!(frame.is_standard() && frame.is_data_frame());
            prop_assert_eq!(<Frame as embedded_can::Frame>::new(read.0, read.2), Some(frame));
            prop_assert_eq!(Frame::from_raw(frame.raw_id(), frame.data()), Some(frame));
        }
    }

    #[test]
    fn extended_remote_and_long_frames_are_refused() {
        let standard = StandardId::new(0x123).expect("11 bits");
        assert_eq!(<Frame as embedded_can::Frame>::new(ExtendedId::new(0x123).expect("29 bits"), &[1]), None);
        assert_eq!(<Frame as embedded_can::Frame>::new(standard, &[0; 9]), None);
        assert_eq!(Frame::new_remote(standard, 0), None);
        assert_eq!(Frame::from_raw(0x800, &[]), None);
    }
}
