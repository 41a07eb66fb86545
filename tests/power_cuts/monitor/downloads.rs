//! Downloads by both hosts: their bus load, and every failure.

use super::rig::{Host, Rig, application, area, data, flash_with, image, line, lines};
use boot::monitor::Next;
use hil_world::rig::flash::SimFlash;
use tater_f103::map::{APPLICATION, MAP};
use tater_wire::{FaultCode, Property};

fn start(rig: &mut Rig) -> Next {
    rig.set(Property::STAT, 2);
    rig.settle()
}

#[test]
fn download_of_48_kib_takes_the_stated_time() {
    let new = image(48 * 1024, 2);
    let file = lines(&new).concat();
    let mut bus = Vec::new();
    for mut host in [Host::barrett(file.as_bytes()), Host::ours(file.as_bytes())] {
        let mut rig = Rig::boot(SimFlash::default());
        let figures = rig.download(&mut host).expect("there is power");
        println!(
            "figure: 48 KiB, {} characters, without stuffing: {} requests, {} frames, bus busy {} us; in all {} us",
            host.characters(),
            figures.requests,
            figures.frames,
            figures.bus_us,
            figures.took_us
        );
        assert_eq!((rig.error(), rig.lost), (None, 0));
        assert_eq!(area(rig.flash(), APPLICATION, new.len()), new);
        assert_eq!(start(&mut rig), Next::Start);
        bus.push(figures.bus_us);
    }
    assert!(bus[0] >= 5 * bus[1], "Must show 3: a fifth of the bus at most, {bus:?}");
}

/// Files that must be refused, the ERROR, and their defect.
fn damaged(new: &[u8]) -> Vec<(FaultCode, String, &'static str)> {
    let good = lines(new);
    let with = |i: usize, text: String| {
        let mut lines = good.clone();
        lines[i] = text;
        lines.concat()
    };
    let flipped = |i: usize| {
        let mut image = new.to_vec();
        image[i] ^= 4;
        lines(&image).concat()
    };
    let mut wrong = good[40].clone().into_bytes();
    wrong[50] = if wrong[50] == b'7' { b'8' } else { b'7' };
    let wrong = String::from_utf8(wrong).expect("ASCII");
    let overlapping = data(APPLICATION.start + 40 * 32 - 2, &new[40 * 32 - 2..41 * 32]);
    vec![
        (FaultCode::BadChecksum, with(40, wrong), "bad checksum"),
        (FaultCode::BadRecord, with(40, "%4F5000000000\r\n".into()), "a type that there is not"),
        (FaultCode::AddressRange, with(40, data(MAP.staging.start, &[1; 32])), "beyond the application"),
        (FaultCode::AddressRange, with(40, data(0x0800_0000, &[1; 32])), "the monitor"),
        (FaultCode::Overlap, with(40, overlapping), "overlap"),
        (FaultCode::DownloadTimeout, good[..good.len() - 1].concat(), "no termination"),
        (FaultCode::BadImage, with(40, line("300")), "a record is missing"),
        (FaultCode::BadImage, flipped(1500), "bad CRC"),
        (FaultCode::BadImage, flipped(0x1D), "unsealed"),
        (FaultCode::BadImage, [good[..41].concat(), good[good.len() - 1].clone()].concat(), "cut short"),
    ]
}

#[test]
fn failed_download_keeps_old_application_and_allows_another() {
    let (old, new) = (image(3000, 1), image(2100, 2));
    let good = lines(&new).concat();
    for (error, file, what) in damaged(&new) {
        for host in [Host::barrett, Host::ours] {
            let mut rig = Rig::boot(flash_with(&old));
            rig.download(&mut host(file.as_bytes())).expect("there is power");
            assert_eq!(rig.error(), Some(error), "{what}");
            assert_eq!(rig.get(Property::ERROR), Some(i64::from(error.code())), "{what}");
            assert_eq!(rig.settle(), Next::Stay);
            assert_eq!(area(rig.flash(), APPLICATION, old.len()), old, "{what}");
            let mut again = Rig::boot(rig.flash().clone());
            assert_eq!(start(&mut again), Next::Start, "{what}");
            rig.download(&mut host(good.as_bytes())).expect("there is power");
            assert_eq!((rig.error(), start(&mut rig)), (None, Next::Start), "{what}");
            assert_eq!(application(rig.flash()).map(|header| header.version), Some(2), "{what}");
        }
    }
}

#[test]
fn host_that_dies_at_any_record_leaves_a_usable_board() {
    let (old, new) = (image(3000, 1), image(2100, 2));
    let all = lines(&new);
    for sent in 0..all.len() {
        for host in [Host::barrett, Host::ours] {
            let mut rig = Rig::boot(flash_with(&old));
            let figures = rig.download(&mut host(all[..sent].concat().as_bytes())).expect("there is power");
            assert!(figures.took_us > 10_000_000 && figures.took_us < 11_000_000, "{figures:?}");
            assert_eq!(rig.error(), Some(FaultCode::DownloadTimeout));
            assert_eq!(area(rig.flash(), APPLICATION, old.len()), old);
            rig.download(&mut host(all.concat().as_bytes())).expect("there is power");
            assert_eq!((rig.error(), rig.lost, start(&mut rig)), (None, 0, Next::Start));
            assert_eq!(area(rig.flash(), APPLICATION, new.len()), new);
        }
    }
}
