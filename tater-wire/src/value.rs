//! A property's value as it is on the wire: bits and a width. What the bits mean is the property's.

/// A value as it is on the wire, with its width. What the bits mean is the property's: [`Property::read`](crate::Property::read).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Value {
    /// Two bytes: a frame of DLC 4.
    Short(u16),
    /// Four bytes: a frame of DLC 6.
    Long(u32),
}
