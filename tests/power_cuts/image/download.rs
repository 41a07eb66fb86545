//! Cuts in a download: the erase of staging, its programming, the copy to the application, and the end.

use board_emu::image::Programs;
use tater_f103::map::{APPLICATION, MAP, STORAGE};
use tater_wire::download::{Downloader, Next};
use tater_wire::image::seal;
use tater_wire::map::Area;

use super::super::monitor::rig::{Operation, area};
use super::{Story, flash_of, initial, is_cut, monitor, start, wake};
use crate::emulated::bench::{Bench, NODE, id, production};
use crate::protocol::download::file;

/// The same application with another version: the header tells old from new.
fn newer(programs: &Programs) -> Vec<u8> {
    let mut image = programs.application.clone();
    seal(&mut image, 999, &MAP).expect("an application");
    image
}

/// Our download, up to the start of the application, or to a power cut.
fn download(bench: &mut Bench, image: &[u8]) {
    let file = file(image);
    let mut host = Downloader::new(id(NODE), &file, bench.bus.now_us());
    while !is_cut(bench) {
        match host.next(bench.bus.now_us()) {
            Next::Done => return,
            Next::Failed(error) => panic!("{error:?}: {:?}", bench.board().problem()),
            Next::Send(frame) => bench.bus.send(frame).expect("plugged"),
            Next::Wait(until) => {
                if let Some(stamped) = bench.bus.wait(until) {
                    host.receive(&stamped.frame, stamped.at_us);
                }
            }
        }
    }
}

fn act(bench: &mut Bench) {
    let programs = production().expect("the test has it");
    download(bench, &newer(&programs));
}

/// One half-word in so many of a phase is cut.
const EACH: usize = 600;

/// Some erases and half-words of staging and of the copy, and every operation at the end of a download.
fn cuts(story: &Story) -> Vec<usize> {
    let mut seen = [0; 2];
    let chosen = |(i, operation): (usize, &Operation)| {
        let (address, erase) = match *operation {
            Operation::Program(address, _) => (address, false),
            Operation::Erase(page) => (page, true),
        };
        let inside = |area: Area| area.holds(address.into(), 1);
        if inside(STORAGE) {
            // The application's first start, which the other test covers.
            return None;
        }
        let last = inside(MAP.staging) && seen[1] > 0;
        let count = &mut seen[usize::from(inside(APPLICATION))];
        *count += 1;
        let each = if erase { 3 } else { EACH };
        (last || *count < 6 || *count % each == 1).then_some(i)
    };
    story.log.iter().enumerate().filter_map(chosen).collect()
}

#[test]
fn cut_download_of_the_image_leaves_old_or_new_application() {
    let Some(programs) = production() else { return };
    let (old, new) = (programs.application.clone(), newer(&programs));
    assert!(old != new);
    let mut bench = start(&programs, &initial(&programs));
    download(&mut bench, &new);
    let story = Story::of(initial(&programs), &bench);
    let of = |area: Area| {
        move |operation: &Operation| {
            let (Operation::Program(address, _) | Operation::Erase(address)) = *operation;
            area.holds(address.into(), 1)
        }
    };
    let copied = story.log.iter().position(of(APPLICATION)).expect("a copy");
    let cuts = cuts(&story);
    for operation in [cuts[3], cuts[20], copied, copied + 100] {
        story.really_cut(&programs, operation, 7, act);
    }
    let mut found = [0; 2];
    for (i, &operation) in cuts.iter().enumerate() {
        let mut bench = start(&programs, story.cut(operation, i as u64).bytes());
        monitor(&mut bench);
        wake(&mut bench);
        let flash = flash_of(&bench);
        let is_new = area(&flash, APPLICATION, new.len()) == new;
        assert!(is_new || area(&flash, APPLICATION, old.len()) == old, "operation {operation}: neither");
        assert!(is_new || operation < copied, "operation {operation}: the copy was owed");
        found[usize::from(is_new)] += 1;
        if i % 30 == 7 {
            download(&mut bench, &new);
            assert!(area(&flash_of(&bench), APPLICATION, new.len()) == new, "downloadable");
        }
    }
    let [old, new] = found;
    println!(
        "figure: power cuts of the image, download: {} in {} flash operations; then the old application {old} times, the new \
         one {new}",
        cuts.len(),
        story.log.len()
    );
    assert!(old > 0 && new > 0);
    // With those of storage at least 200.
    assert!(cuts.len() >= 100, "{}", cuts.len());
}
