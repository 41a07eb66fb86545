use super::*;
use crate::map::{Area, Memories};
use std::{format, string::ToString, vec::Vec};

const RAM: Area = Area { start: 0x2000_0000, len: 20 * 1024 };
const MAP: Map = Map::new(
    Memories { flash: Area { start: 0x0800_0000, len: 128 * 1024 }, page: 1024, unit: 2, ram: RAM },
    16 * 1024,
    8 * 1024,
);
const APPLICATION: Area = MAP.application;

/// An application of `len` bytes with valid vectors and zeros in the reserved ones.
fn linked(len: usize) -> Vec<u8> {
    let mut image: Vec<u8> = (0..len).map(|i| (i % 251) as u8).collect();
    put(&mut image, 0, RAM.end());
    put(&mut image, 4, APPLICATION.start + HEADER_END + 1);
    for at in (0x1C..HEADER_END).step_by(4) {
        put(&mut image, at, 0);
    }
    image
}

fn put(image: &mut [u8], at: u32, word: u32) {
    image[at as usize..][..4].copy_from_slice(&word.to_le_bytes());
}

fn sealed(len: usize) -> Vec<u8> {
    let mut image = linked(len);
    seal(&mut image, 600, &MAP).expect("it can be sealed");
    image
}

#[test]
fn sealed_image_verifies_and_differs_only_in_its_header() {
    for len in [48, 52, 4096, APPLICATION.len as usize] {
        let mut image = linked(len);
        let header = seal(&mut image, 0x1234_5678, &MAP).expect("it can be sealed");
        assert_eq!(Header::verify(&image, &MAP), Ok(header));
        assert_eq!(Header::read(&image[..HEADER_END as usize], &MAP), Ok(header));
        assert_eq!((header.len as usize, header.version), (len, 0x1234_5678));
        assert_eq!(&image[0x1C..0x20], b"TatR");
        assert_eq!(image[..0x1C], linked(len)[..0x1C]);
        assert_eq!(image[0x2C..], linked(len)[0x2C..]);
    }
}

/// The check value is part of the definition of ISO-HDLC.
#[test]
fn crc_matches_zip() {
    let mut summer = Summer::default();
    summer.update(b"123456789");
    assert_eq!(summer.finish(), 0xCBF4_3926);

    // The CRC word counts as erased flash, in pieces of any size.
    let mut image = sealed(512);
    let header = Header::verify(&image, &MAP).expect("it is sealed");
    for piece in [1, 3, 37, 512] {
        let mut summer = Summer::default();
        image.chunks(piece).for_each(|bytes| summer.update(bytes));
        assert_eq!(summer.finish(), header.crc, "pieces of {piece}");
    }
    put(&mut image, CRC_AT, u32::MAX);
    assert_eq!(crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&image), header.crc);
}

#[test]
fn every_changed_bit_is_detected() {
    let image = sealed(256);
    for bit in 0..image.len() * 8 {
        let mut changed = image.clone();
        changed[bit / 8] ^= 1 << (bit % 8);
        assert!(Header::verify(&changed, &MAP).is_err(), "bit {bit}");
    }
}

#[test]
fn sealing_again_replaces_the_header_and_nothing_else() {
    let mut image = sealed(100);
    seal(&mut image, 601, &MAP).expect("a header may be replaced");
    assert_eq!(Header::verify(&image, &MAP).map(|header| header.version), Ok(601));
    let mut erased = linked(100);
    for at in (0x1C..HEADER_END).step_by(4) {
        put(&mut erased, at, u32::MAX);
    }
    seal(&mut erased, 601, &MAP).expect("erased vectors are free");
    assert_eq!(erased, image);
}

#[test]
fn invalid_lengths_are_refused() {
    let most = APPLICATION.len as usize;
    for len in [0, 3, 4, 0x1F, 0x20, 0x2B, 45, 46, 47, most + 1, most + 4] {
        let mut image = linked(len.max(48));
        image.truncate(len);
        let found = len as u32;
        assert_eq!(
            seal(&mut image, 1, &MAP),
            Err(ImageError::Length { found, most: APPLICATION.len }),
            "{len}"
        );
    }
    for len in [0, 0x1C, 0x2B] {
        let found = len as u32;
        assert_eq!(
            Header::read(&sealed(48)[..len], &MAP),
            Err(ImageError::Length { found, most: APPLICATION.len }),
            "{len}"
        );
    }
    for found in [0, 0x28, 49, APPLICATION.len + 4, u32::MAX - 3] {
        let mut image = sealed(48);
        put(&mut image, LEN_AT, found);
        assert_eq!(Header::read(&image, &MAP), Err(ImageError::Length { found, most: APPLICATION.len }));
    }
    let image = sealed(100);
    assert_eq!(
        Header::verify(&image[..96], &MAP),
        Err(ImageError::Length { found: 96, most: APPLICATION.len })
    );
    let longer = [&image[..], &[0xFF; 4]].concat();
    assert_eq!(Header::verify(&longer, &MAP), Err(ImageError::Length { found: 104, most: APPLICATION.len }));
}

#[test]
fn invalid_stack_pointers_are_refused() {
    for (found, good) in [
        (RAM.end(), true),
        (RAM.start + 4, true),
        (RAM.start, false),
        (RAM.end() + 4, false),
        (RAM.end() - 2, false),
        (0, false),
        (u32::MAX, false),
        (APPLICATION.start, false),
    ] {
        let (mut image, mut signed) = (linked(100), sealed(100));
        put(&mut image, 0, found);
        put(&mut signed, 0, found);
        let error = ImageError::Stack { found, end: RAM.end() };
        assert_eq!(seal(&mut image, 1, &MAP).err(), (!good).then_some(error), "{found:#x}");
        assert_eq!(Header::read(&signed, &MAP).err(), (!good).then_some(error), "{found:#x}");
    }
}

#[test]
fn invalid_reset_vectors_are_refused() {
    let start = APPLICATION.start;
    for (found, good) in [
        (start + HEADER_END + 1, true),
        (start + 99, true),
        (start + HEADER_END - 1, false),
        (start + 101, false),
        (start + HEADER_END, false),
        (0, false),
        (1, false),
        (u32::MAX, false),
    ] {
        let (mut image, mut signed) = (linked(100), sealed(100));
        put(&mut image, 4, found);
        put(&mut signed, 4, found);
        let error = ImageError::Reset { found };
        assert_eq!(seal(&mut image, 1, &MAP).err(), (!good).then_some(error), "{found:#x}");
        assert_eq!(Header::read(&signed, &MAP).err(), (!good).then_some(error), "{found:#x}");
    }
}

#[test]
fn image_without_a_header_is_unsealed() {
    assert_eq!(Header::verify(&linked(100), &MAP), Err(ImageError::Unsealed));
    assert_eq!(Header::verify(&[0xFF; 100], &MAP), Err(ImageError::Unsealed));
    // The magic is checked before the vectors: erased flash is unsealed, whatever its stack pointer.
    assert_eq!(Header::read(&[0; HEADER_END as usize], &MAP), Err(ImageError::Unsealed));
}

#[test]
fn reserved_vectors_in_use_are_not_overwritten() {
    for at in [MAGIC_AT, LEN_AT, CRC_AT, VERSION_AT] {
        let mut image = linked(100);
        put(&mut image, at, 0x0800_4101);
        let before = image.clone();
        assert_eq!(seal(&mut image, 1, &MAP), Err(ImageError::Reserved), "{at:#x}");
        assert_eq!(image, before);
    }
}

#[test]
fn wrong_crc_error_has_both_values() {
    let mut image = sealed(100);
    let expected = Header::verify(&image, &MAP).expect("it is sealed").crc;
    image[99] ^= 0x80;
    let Err(ImageError::Crc { found, expected: said }) = Header::verify(&image, &MAP) else {
        panic!("a changed byte is a wrong CRC");
    };
    assert_eq!(said, expected);
    assert_ne!(found, expected);
    image[99] ^= 0x80;
    put(&mut image, CRC_AT, found);
    assert_eq!(Header::verify(&image, &MAP), Err(ImageError::Crc { found: expected, expected: found }));
}

#[test]
fn error_texts_have_the_value_found() {
    let rows = [
        (ImageError::Length { found: 45, most: APPLICATION.len }, "45 bytes"),
        (ImageError::Stack { found: 0x1234, end: RAM.end() }, "0x00001234"),
        (ImageError::Reset { found: 0x1234 }, "0x00001234"),
        (ImageError::Unsealed, "not sealed"),
        (ImageError::Reserved, "cannot be sealed"),
        (ImageError::Crc { found: 0x12, expected: 0x34 }, "0x00000012, but its header says 0x00000034"),
    ];
    for (error, words) in rows {
        assert!(error.to_string().contains(words), "{}", format!("{error}"));
    }
}
