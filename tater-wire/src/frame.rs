//! The bytes on the bus: an 11-bit identifier and up to eight data bytes. Remote and extended frames are not spoken.

use crate::id::Identifier;

/// A classic CAN data frame.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    id: u16,
    len: u8,
    /// Zero from `len` on, so that equal frames are equal.
    bytes: [u8; 8],
}

impl Frame {
    /// From the host to itself, without data: means nothing to anybody.
    pub const EMPTY: Self = Self { id: 0, len: 0, bytes: [0; 8] };

    /// `None` for more than eight bytes.
    #[must_use]
    pub fn new(id: Identifier, data: &[u8]) -> Option<Self> {
        let mut bytes = [0; 8];
        bytes.get_mut(..data.len())?.copy_from_slice(data);
        Some(Self { id: id.raw(), len: u8::try_from(data.len()).ok()?, bytes })
    }

    /// From what a CAN controller gives; `None` for an identifier above 0x7FF or more than eight bytes.
    #[must_use]
    pub fn from_raw(id: u16, data: &[u8]) -> Option<Self> {
        Self::new(Identifier::from_raw(id)?, data)
    }

    /// The identifier's 11 bits, which are also the frame's priority: the lowest wins.
    #[must_use]
    pub const fn raw_id(&self) -> u16 {
        self.id
    }

    /// The identifier.
    #[must_use]
    pub fn id(&self) -> Identifier {
        // 11 bits by construction.
        Identifier::from_raw(self.id & 0x7FF).unwrap_or(Identifier {
            from: crate::Node::HOST,
            to: crate::Destination::Node(crate::Node::HOST),
        })
    }

    /// The data, 0 to 8 bytes.
    #[must_use]
    pub fn data(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.len)).unwrap_or(&[])
    }
}

impl core::fmt::Debug for Frame {
    /// As CAN tools write it: `406#80020000`.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{:03X}#", self.id)?;
        for byte in self.data() {
            write!(f, "{byte:02X}")?;
        }
        Ok(())
    }
}
