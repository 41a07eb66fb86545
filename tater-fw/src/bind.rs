//! Binds properties to the fields of a struct: one line each gives reading, writing and listing.

/// The field of a property, in the field's own width.
pub enum Slot<'a> {
    Bool(&'a mut bool),
    U8(&'a mut u8),
    U16(&'a mut u16),
    I16(&'a mut i16),
    I32(&'a mut i32),
    U32(&'a mut u32),
}

impl Slot<'_> {
    pub fn value(&self) -> i32 {
        match self {
            Self::Bool(field) => i32::from(**field),
            Self::U8(field) => i32::from(**field),
            Self::U16(field) => i32::from(**field),
            Self::I16(field) => i32::from(**field),
            Self::I32(field) => **field,
            Self::U32(field) => field.cast_signed(),
        }
    }

    /// Takes the low bits of the value. Callers have compared it with the property's range, which fits the field: a fallible
    /// conversion of each field would cost 2 KB of flash.
    pub const fn set(self, value: i32) {
        let [low, high, ..] = value.to_le_bytes();
        match self {
            Self::Bool(field) => *field = low != 0,
            Self::U8(field) => *field = low,
            Self::U16(field) => *field = u16::from_le_bytes([low, high]),
            Self::I16(field) => *field = i16::from_le_bytes([low, high]),
            Self::I32(field) => *field = value,
            Self::U32(field) => *field = value.cast_unsigned(),
        }
    }
}

macro_rules! from {
    ($($variant:ident: $type:ty),*) => {$(
        impl<'a> From<&'a mut $type> for Slot<'a> {
            fn from(field: &'a mut $type) -> Self {
                Self::$variant(field)
            }
        }
    )*};
}
from!(Bool: bool, U8: u8, U16: u16, I16: i16, I32: i32, U32: u32);

/// `bind!(pattern for Struct: NAME = field, ...)` gives `PROPERTIES`, `get` and `set` for the struct, and a macro of
/// the given name that matches any of them, for exhaustive matches over all properties.
macro_rules! bind {
    ($pattern:ident for $struct:ty: $($property:ident = $($field:ident).+,)*) => {
        /// The properties that are here.
        pub const PROPERTIES: [tater_wire::Property; [$(stringify!($property)),*].len()] =
            [$(tater_wire::Property::$property),*];

        /// The only place that knows which field holds a property. `None` if it is not here.
        #[inline(never)]
        fn slot(of: &mut $struct, property: tater_wire::Property) -> Option<$crate::bind::Slot<'_>> {
            match property {
                $(tater_wire::Property::$property => Some($crate::bind::Slot::from(&mut of.$($field).+)),)*
                _ => None,
            }
        }

        /// The value of a property; `None` if it is not here.
        #[must_use]
        pub fn get(from: &$struct, property: tater_wire::Property) -> Option<i32> {
            // A copy, so that one function finds the field for readers and writers.
            let mut copy = *from;
            slot(&mut copy, property).map(|slot| slot.value())
        }

        /// Tells the value of each property.
        pub fn each(from: &$struct, mut tell: impl FnMut(tater_wire::Property, i32)) {
            let mut copy = *from;
            for property in PROPERTIES {
                if let Some(slot) = slot(&mut copy, property) {
                    tell(property, slot.value());
                }
            }
        }

        /// Sets each property for which `value` is `Some`. Values must be within the rows' ranges.
        pub fn fill(to: &mut $struct, mut value: impl FnMut(tater_wire::Property) -> Option<i32>) {
            for property in PROPERTIES {
                if let Some(value) = value(property) {
                    let _ = set(to, property, value);
                }
            }
        }

        #[cfg(test)]
        fn fills_and_tells_each(mut all: $struct) {
            fill(&mut all, |property| i32::try_from(property.row().max).ok());
            let mut told = std::vec::Vec::new();
            each(&all, |property, value| told.push((property, i64::from(value))));
            assert_eq!(told, PROPERTIES.map(|property| (property, property.row().max)));
            let before = all;
            fill(&mut all, |_| None);
            assert_eq!(all, before, "what has no value stays");
        }

        /// Sets a property to a value within its row's range. `false` if it is not here.
        #[must_use]
        pub fn set(to: &mut $struct, property: tater_wire::Property, value: i32) -> bool {
            slot(to, property).map(|slot| slot.set(value)).is_some()
        }

        macro_rules! $pattern {
            () => {
                $(tater_wire::Property::$property)|*
            };
        }
        pub(crate) use $pattern;
    };
}
pub(crate) use bind;
