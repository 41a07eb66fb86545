//! Power cuts in the monitor.
//!
//! A download runs once, with a log of its flash operations. Until an operation fails the monitor behaves the same, so
//! the flash after a cut is the flash before the operation, with the operation half done. A sample of real cuts checks this.

mod downloads;
mod noise;
pub(super) mod rig;

use boot::monitor::Next;
use hil_world::rig::flash::SimFlash;
use rig::{Host, NODE, Operation, Rig, application, flash_with, image, lines};
use std::collections::HashSet;
use tater_wire::{Body, Message, Property};

/// Seeds for each operation: with the second cuts some 60,000 states, the monitor's share of 100,000.
const SEEDS: u64 = 10;

/// One state in so many gets a whole download afterwards; all get as far as the first request.
const SAMPLE: usize = 97;

struct Trial {
    old: Option<Vec<u8>>,
    new: Vec<u8>,
    host: fn(&[u8]) -> Host,
    states: HashSet<u64>,
    tried: usize,
    /// Versions found after recovery: none, old, new.
    found: [usize; 3],
}

impl Trial {
    fn new(old: Option<Vec<u8>>, host: fn(&[u8]) -> Host) -> Self {
        // Three pages, the last partly filled.
        let new = image(2100, 2);
        Self { old, new, host, states: HashSet::new(), tried: 0, found: [0; 3] }
    }

    fn before(&self) -> SimFlash {
        self.old.as_deref().map_or_else(SimFlash::default, flash_with)
    }

    fn download(&self, rig: &mut Rig) -> bool {
        rig.download(&mut (self.host)(lines(&self.new).concat().as_bytes())).is_some()
    }

    fn operations(&self) -> Vec<Operation> {
        let mut rig = Rig::boot(self.before());
        assert!(self.download(&mut rig));
        assert_eq!(application(rig.flash()).map(|header| header.version), Some(2));
        rig.into_flash().log
    }

    fn cut_everywhere(&mut self) {
        let operations = self.operations();
        for seed in 0..SEEDS {
            let mut flash = self.before();
            for (i, operation) in operations.iter().enumerate() {
                let mut cut = flash.clone();
                cut.cut_at(cut.operations(), seed);
                assert!(operation.apply(&mut cut).is_err() && cut.is_dead());
                if seed == 0 && i % 101 == 0 {
                    self.check_replay(flash.operations(), &cut);
                }
                let recovery = self.recover(cut.clone());
                self.cut_again(cut, recovery, seed << 32 | i as u64);
                operation.apply(&mut flash).expect("there is power");
            }
        }
    }

    fn check_replay(&self, operation: u64, replayed: &SimFlash) {
        let mut flash = self.before();
        flash.cut_at(operation, 0);
        let mut rig = Rig::boot(flash);
        assert!(!self.download(&mut rig));
        assert!(rig.run_into_cut());
        assert!(rig.flash().bytes() == replayed.bytes(), "operation {operation}");
    }

    fn cut_again(&mut self, mut flash: SimFlash, operations: usize, seed: u64) {
        if operations == 0 {
            return;
        }
        flash.power_up();
        // A multiplier of PCG: scatters the operations over all seeds.
        let at = seed.wrapping_mul(0x5851_F42D_4C95_7F2D) >> 32;
        flash.cut_at(flash.operations() + at % operations as u64, seed);
        let mut rig = Rig::boot(flash);
        assert!(rig.run_into_cut());
        self.recover(rig.into_flash().sim);
    }

    /// Expects the old or the new application, and a monitor that takes a download. Returns the recovery's operations.
    fn recover(&mut self, mut flash: SimFlash) -> usize {
        self.tried += 1;
        self.states.insert(hash(flash.bytes()));
        let had_one = self.old.is_some();
        flash.power_up();
        let mut rig = Rig::boot(flash);
        assert_eq!(rig.settle(), Next::Stay, "nobody has asked for the application");
        let operations = rig.monitor.board().flash.log.len();
        let version = application(rig.flash()).map(|header| header.version);
        self.found[version.map_or(0, |version| version as usize)] += 1;
        assert!(version.is_some() || !had_one, "neither old nor new");
        assert_eq!(rig.get(Property::STAT), Some(0), "alive");
        assert_eq!(rig.get(Property::ERROR), Some(0));
        rig.set(Property::STAT, 2);
        let next = if version.is_some() { Next::Start } else { Next::Stay };
        assert_eq!(rig.settle(), next, "started if there is one");
        let mut rig = Rig::boot(rig.into_flash().sim);
        if self.tried.is_multiple_of(SAMPLE) {
            assert!(self.download(&mut rig));
            assert_eq!(rig.error(), None);
            assert_eq!(application(rig.flash()).map(|header| header.version), Some(2));
        } else {
            rig.set(Property::VERS, 0xAA);
            let first = (0..50).find_map(|_| rig.step().1.pop()).expect("a request");
            let request = Message::parse(&first).map(|message| (message.from, message.body));
            assert_eq!(request, Some((NODE, Body::Get(Property::VERS.id()))), "downloadable");
        }
        operations
    }
}

/// Fowler-Noll-Vo over words of 8 bytes: it only has to distinguish states.
fn hash(bytes: &[u8]) -> u64 {
    bytes.chunks_exact(8).fold(0xCBF2_9CE4_8422_2325, |hash, word| {
        let word = word.try_into().map_or(0, u64::from_le_bytes);
        (hash ^ word).wrapping_mul(0x0000_0100_0000_01B3).rotate_left(29)
    })
}

fn try_all(before: &str, mut trial: Trial) -> usize {
    trial.cut_everywhere();
    let (distinct, [none, old, new]) = (trial.states.len(), trial.found);
    println!(
        "figure: power cuts of the monitor ({before} before): {} cuts, {distinct} distinct states; then no application {none} \
         times, the old one {old}, the new one {new}",
        trial.tried
    );
    assert!(new > 0 && (old > 0) == trial.old.is_some() && (none > 0) == trial.old.is_none());
    distinct
}

#[test]
fn cut_download_leaves_old_or_new_application() {
    // Half of the monitor's share of 50,000; fewer would mean that operations or seeds were skipped.
    assert!(try_all("an application", Trial::new(Some(image(2900, 1)), Host::ours)) >= 25_000);
}

#[test]
fn cut_download_without_application_leaves_none_or_new() {
    assert!(try_all("no application", Trial::new(None, Host::barrett)) >= 25_000);
}
