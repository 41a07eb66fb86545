//! Binds properties to the fields of a struct: one line each gives reading, writing and listing.

pub trait Raw: Copy {
    fn value(self) -> i64;
    /// `None` if the value does not fit the field.
    fn of(value: i64) -> Option<Self>;
}

macro_rules! raw {
    ($($type:ty),*) => {$(
        impl Raw for $type {
            fn value(self) -> i64 {
                i64::from(self)
            }
            fn of(value: i64) -> Option<Self> {
                Self::try_from(value).ok()
            }
        }
    )*};
}
raw!(u8, u16, i16, i32);

impl Raw for bool {
    fn value(self) -> i64 {
        i64::from(self)
    }
    fn of(value: i64) -> Option<Self> {
        match value {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }
}

/// `bind!(pattern for Struct: NAME = field, ...)` gives `PROPERTIES`, `get` and `set` for the struct, and a macro of
/// the given name that matches any of them, for exhaustive matches over all properties.
macro_rules! bind {
    ($pattern:ident for $struct:ty: $($property:ident = $field:ident,)*) => {
        /// The properties that are here.
        #[allow(dead_code, reason = "some are listed by tests alone")]
        pub const PROPERTIES: [tater_wire::Property; [$(stringify!($property)),*].len()] =
            [$(tater_wire::Property::$property),*];

        /// The value of a property; `None` if it is not here.
        #[must_use]
        pub fn get(from: &$struct, property: tater_wire::Property) -> Option<i64> {
            match property {
                $(tater_wire::Property::$property => Some($crate::bind::Raw::value(from.$field)),)*
                _ => None,
            }
        }

        /// Tells the value of each property: all are done in a fraction of the time that [`get`] takes of each.
        pub fn each(from: &$struct, mut tell: impl FnMut(tater_wire::Property, i64)) {
            $(tell(tater_wire::Property::$property, $crate::bind::Raw::value(from.$field));)*
        }

        /// Sets each property for which `value` is `Some` and fits the field. Does not check ranges.
        // Inlined, it takes twice the flash.
        #[inline(never)]
        pub fn fill(to: &mut $struct, mut value: impl FnMut(tater_wire::Property) -> Option<i32>) {
            $(if let Some(value) = value(tater_wire::Property::$property)
                && let Some(value) = $crate::bind::Raw::of(value.into())
            {
                to.$field = value;
            })*
        }

        #[cfg(test)]
        fn fills_and_tells_each(mut all: $struct) {
            fill(&mut all, |property| i32::try_from(property.row().max).ok());
            let mut told = std::vec::Vec::new();
            each(&all, |property, value| told.push((property, value)));
            assert_eq!(told, PROPERTIES.map(|property| (property, property.row().max)));
            let before = all;
            fill(&mut all, |property| (property == PROPERTIES[0]).then_some(i32::MAX));
            assert_eq!(all, before, "what does not fit is not taken");
        }

        /// `false`, and nothing changed, if the property is not here or its field cannot hold the value. Does not check ranges.
        #[must_use]
        pub fn set(to: &mut $struct, property: tater_wire::Property, value: i64) -> bool {
            match property {
                $(tater_wire::Property::$property => match $crate::bind::Raw::of(value) {
                    Some(value) => {
                        to.$field = value;
                        true
                    }
                    None => false,
                },)*
                _ => false,
            }
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
