//! Hands in the network, and firmware for their boards: the manual's discoverGrasper and downloadFirmware.

use std::ffi::{c_char, c_int, c_void};
use std::net::SocketAddrV4;
use std::ops::ControlFlow;
use std::path::Path;

use wraptor::discovery::EVERYWHERE;
use wraptor::{Firmware, Found, discover};

use crate::border::{border, deadline, store, store_text, text, with_hand};
use crate::error::{Problem, wraptor_error};
use crate::slot::wraptor_hand;

/// Called some five times a second with how much has been sent to a board. Returns 0 to cancel.
// SAFETY: who passes one promises that it may be called like this.
pub type wraptor_on_download =
    Option<unsafe extern "C" fn(context: *mut c_void, node: c_int, percent: c_int) -> c_int>;

/// Bytes of `02:57:00:01:2A:F9` and of `255.255.255.255`, each with its zero.
const MAC: usize = 18;
const ADDRESS: usize = 16;

/// Finds the hand in the network by a UDP broadcast (the manual's discoverGrasper), listening for the whole limit. `place` is NULL, or an IPv4
/// ADDRESS:PORT for questions to it alone, such as the broadcast address of another network, port 30718. Stores the hardware address (`mac`, 18 bytes with
/// its zero, empty if the hand does not tell it), the IP address (`address`, 16 bytes) and the port; empty texts and 0 after an error.
///
/// Errors: WRAPTOR_NOT_CONNECTED if no hand answers, or more than one.
///
/// # Safety
/// `place` is NULL or a string; `mac` and `address` are NULL or have `mac_size` and `address_size` bytes that may be written; `port` is NULL or may be
/// written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_discover_grasper(
    place: *const c_char,
    mac: *mut c_char,
    mac_size: usize,
    address: *mut c_char,
    address_size: usize,
    port: *mut c_int,
    limit_ms: u32,
) -> wraptor_error {
    border(|| {
        let places = match place.is_null() {
            true => EVERYWHERE.to_vec(),
            // SAFETY: the caller's promise.
            false => vec![address_of(unsafe { text("place", place) }?)?],
        };
        for (name, is_null) in
            [("mac", mac.is_null()), ("address", address.is_null()), ("port", port.is_null())]
        {
            if is_null {
                return Err(Problem::null(name));
            }
        }
        for (name, size, least) in [("mac_size", mac_size, MAC), ("address_size", address_size, ADDRESS)] {
            if size < least {
                return Err(Problem::invalid(&format!("{name}: found {size}, expected {least} or more")));
            }
        }
        // SAFETY: the caller's promise.
        unsafe {
            store_text(mac, mac_size, "");
            store_text(address, address_size, "");
            store("port", port, 0)?;
        }
        let found = only(discover(&places, deadline(limit_ms).remaining())?)?;
        let hardware = found
            .hardware
            .map_or_else(String::new, |bytes| bytes.map(|byte| format!("{byte:02X}")).join(":"));
        // SAFETY: the caller's promise.
        unsafe {
            store_text(mac, mac_size, &hardware);
            store_text(address, address_size, &found.address.ip().to_string());
            store("port", port, found.address.port().into())
        }
    })
}

fn address_of(place: &str) -> Result<SocketAddrV4, Problem> {
    place.parse().map_err(|_| {
        Problem::invalid(&format!("place {place:?}: expected ADDRESS:PORT, such as 10.0.0.255:30718"))
    })
}

/// The one hand among answers. A hand that is reached in two ways is one.
fn only(mut found: Vec<Found>) -> Result<Found, Problem> {
    found.dedup_by_key(|found| (found.hardware, found.address.port()));
    match found[..] {
        [hand] => Ok(hand),
        [] => {
            let text = "hands: none answers\n  next: check the hand's power and cable, and that it is in this network";
            Err(Problem::new(wraptor_error::WRAPTOR_NOT_CONNECTED, text))
        }
        _ => {
            let all: Vec<String> = found.iter().map(|found| found.address.to_string()).collect();
            let text = format!("hands: {} answer\n  next: connect to one by its address", all.join(", "));
            Err(Problem::new(wraptor_error::WRAPTOR_NOT_CONNECTED, text))
        }
    }
}

/// Downloads a `.tek` file to boards, one after the other (the manual's downloadFirmware), and waits until each runs it. `on_download` may be NULL.
///
/// Errors: WRAPTOR_FILE, before anything is sent; WRAPTOR_DOWNLOAD, whose text names the board.
///
/// # Safety
/// `nodes` and `file` are NULL or strings; `on_download` is NULL or may be called with `context`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_download_firmware(
    hand: wraptor_hand,
    nodes: *const c_char,
    file: *const c_char,
    on_download: wraptor_on_download,
    context: *mut c_void,
    limit_ms: u32,
) -> wraptor_error {
    with_hand(hand, limit_ms, |call| {
        // SAFETY: the caller's promise.
        let (nodes, file) = unsafe { (text("nodes", nodes)?, text("file", file)?) };
        let firmware = Firmware::read(Path::new(file))
            .map_err(|error| Problem::new(wraptor_error::WRAPTOR_FILE, error.to_string()))?;
        let (left, slot) = (call.left(), call.slot);
        call.hand.download(nodes, &firmware, left, &mut |progress| {
            let percent = c_int::try_from(progress.percent()).unwrap_or(100);
            let goes_on = on_download.is_none_or(|on_download| {
                // SAFETY: the caller's promise.
                let goes_on = unsafe { on_download(context, progress.node.number().into(), percent) };
                goes_on != 0
            });
            match goes_on && !slot.is_cancelled() {
                true => ControlFlow::Continue(()),
                false => ControlFlow::Break(()),
            }
        })?;
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_hand_is_found_and_several_are_named() {
        let hand = |address: &str, last| Found {
            address: address.parse().expect("an address"),
            hardware: Some([0, 0x20, 0x4A, 0, 0, last]),
        };
        let (here, there) = (hand("10.0.0.7:1001", 1), hand("127.0.0.1:1001", 1));
        assert!(only(vec![here, there]).is_ok_and(|found| found == here));
        let text = |found| only(found).map_or_else(|problem| problem.text, |_| String::new());
        let several = text(vec![here, hand("10.0.0.8:1001", 2)]);
        assert!(several.starts_with("hands: 10.0.0.7:1001, 10.0.0.8:1001 answer"), "{several}");
        assert!(text(Vec::new()).contains("none answers"));
    }
}
