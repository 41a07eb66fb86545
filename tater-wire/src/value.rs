//! A property's value on the wire: bits and a width. Their meaning depends on the property.

/// A value on the wire, with its width. [`Property::read`](crate::Property::read) interprets it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Value {
    /// Two bytes: a frame of DLC 4.
    Short(u16),
    /// Four bytes: a frame of DLC 6.
    Long(u32),
}
