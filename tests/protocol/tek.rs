//! A sealed image through a `.tek` file, from a host to a monitor. Damaged files: `xtask/tests/tek/damaged.rs`.

use proptest::prelude::*;
use tater_f103::map::{APPLICATION, MAP, RAM};
use tater_wire::image::{Header, seal};
use tater_wire::tek::{Decoder, Encoder, Record, TekError, end};

fn sealed(code: &[u8]) -> Vec<u8> {
    let mut image = vec![0; 0x2C];
    image[..4].copy_from_slice(&RAM.end().to_le_bytes());
    image[4..8].copy_from_slice(&(APPLICATION.start + 0x2D).to_le_bytes());
    image.extend_from_slice(code);
    image.resize(image.len().next_multiple_of(4), 0xFF);
    seal(&mut image, 600, &MAP).expect("the vectors are good");
    image
}

fn file(image: &[u8]) -> Vec<u8> {
    let lines = Encoder::new(APPLICATION.start, image).expect("it lies in flash");
    lines.chain([end(APPLICATION.start)]).flat_map(|line| line.as_bytes().to_vec()).collect()
}

/// The characters that a host sends: of each line those after the first, up to a character below '0'.
fn sent(file: &[u8]) -> Vec<u8> {
    let lines = file.split_inclusive(|&character| character == b'\n');
    lines.flat_map(|line| line[1..].iter().copied().take_while(|&c| c >= b'0')).collect()
}

/// The application's flash after a download; `None` if it does not end.
fn received(characters: &[u8]) -> Result<Option<Vec<u8>>, TekError> {
    let (mut decoder, mut flash, mut whole) = (Decoder::default(), Vec::new(), false);
    for &character in characters {
        match decoder.push(character)? {
            Some(Record::Data { address, bytes }) => {
                if !APPLICATION.holds(address, bytes.len() as u64) {
                    return Ok(None);
                }
                let at = (address - u64::from(APPLICATION.start)) as usize;
                flash.resize(flash.len().max(at + bytes.len()), 0xFF);
                flash[at..at + bytes.len()].copy_from_slice(bytes);
            }
            Some(Record::End { .. }) => whole = true,
            Some(Record::Symbols) | None => {}
        }
    }
    Ok(whole.then_some(flash))
}

proptest! {
    #[test]
    fn sealed_image_arrives(code in prop::collection::vec(any::<u8>(), 1..3000)) {
        let image = sealed(&code);
        let flash = received(&sent(&file(&image)));
        prop_assert_eq!(flash.as_ref(), Ok(&Some(image.clone())));
        prop_assert_eq!(Header::verify(&image, &MAP).map(|header| header.len as usize), Ok(image.len()));
    }
}

#[test]
fn one_wrong_character_ends_the_download() {
    let characters = sent(&file(&sealed(&(0..60).collect::<Vec<u8>>())));
    let whole = |text: &[u8]| matches!(received(text), Ok(Some(_)));
    assert!(whole(&characters));
    for at in 0..characters.len() {
        for other in (b'0'..=b'~').filter(|&other| other != characters[at]) {
            let mut changed = characters.clone();
            changed[at] = other;
            assert!(!whole(&changed), "character {at} as {}", char::from(other));
        }
        let mut lost = characters.clone();
        lost.remove(at);
        assert!(!whole(&lost), "character {at} lost");
    }
}

/// A record's checksum cannot detect two exchanged characters; the image's CRC-32 can.
#[test]
fn exchanged_characters_never_become_another_application() {
    // A record has 78 characters.
    const NEAR: usize = 80;
    let image = sealed(&(0..=255).collect::<Vec<u8>>());
    let characters = sent(&file(&image));
    let mut left_to_the_header = 0;
    for a in 0..characters.len() {
        for b in (a + 1..characters.len().min(a + NEAR)).filter(|&b| characters[a] != characters[b]) {
            let mut changed = characters.clone();
            changed.swap(a, b);
            if let Ok(Some(flash)) = received(&changed).map(|flash| flash.filter(|flash| *flash != image)) {
                left_to_the_header += 1;
                assert!(Header::verify(&flash, &MAP).is_err(), "{a} and {b}");
            }
        }
    }
    assert!(left_to_the_header > 0, "else the header is not needed");
}
