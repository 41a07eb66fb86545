//! What GOD prints: texts and numbers in a row. `core::fmt` would call through pointers, whose stack no analysis bounds, and recurse.

use heapless::String;

/// A text or a number.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Word<'a> {
    Text(&'a str),
    Number(i64),
}

impl<'a> From<&'a str> for Word<'a> {
    fn from(text: &'a str) -> Self {
        Self::Text(text)
    }
}

macro_rules! from_numbers {
    ($($number:ty)*) => {$(
        impl From<$number> for Word<'_> {
            fn from(number: $number) -> Self {
                Self::Number(number.into())
            }
        }
    )*};
}
from_numbers!(i64 u8 u16);

/// The words of a print, each a text or a number.
macro_rules! words {
    ($($word:expr),* $(,)?) => {
        &[$($crate::words::Word::from($word)),*]
    };
}
pub(crate) use words;

/// Appends words to a text; what does not fit is cut off.
pub(crate) fn append<const N: usize>(to: &mut String<N>, words: &[Word<'_>]) {
    for word in words {
        match *word {
            Word::Text(text) => text.chars().for_each(|letter| _ = to.push(letter)),
            Word::Number(number) => append_number(to, number),
        }
    }
}

fn append_number<const N: usize>(to: &mut String<N>, number: i64) {
    if number < 0 {
        let _ = to.push('-');
    }
    let mut rest = number.unsigned_abs();
    // The largest has 19 digits.
    let mut digits = [0u8; 20];
    let mut count = 0;
    for digit in &mut digits {
        *digit = b'0' + (rest % 10) as u8;
        rest /= 10;
        count += 1;
        if rest == 0 {
            break;
        }
    }
    digits.iter().take(count).rev().for_each(|&digit| _ = to.push(char::from(digit)));
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::format;

    proptest! {
        #[test]
        fn numbers_print_as_they_do_elsewhere(number: i64, short: u16, small: u8) {
            let mut text = String::<80>::new();
            append(&mut text, words![number, " of ", short, "/", small]);
            prop_assert_eq!(text.as_str(), format!("{number} of {short}/{small}"));
        }
    }

    #[test]
    fn ends_of_the_numbers_print() {
        for number in [i64::MIN, -10, -1, 0, 9, 10, i64::MAX] {
            let mut text = String::<20>::new();
            append(&mut text, words![number]);
            assert_eq!(text.as_str(), format!("{number}"));
        }
    }

    #[test]
    fn what_does_not_fit_is_cut_off() {
        let mut text = String::<6>::new();
        append(&mut text, words!["motor ", 12u8, "!"]);
        assert_eq!(text.as_str(), "motor ");
    }
}
