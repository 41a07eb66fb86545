//! The runs of a sweep on several threads, their lines in order.

use std::collections::BTreeMap;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread::{Builder, scope};

use super::Sweep;
use traces::input::BadInput;

/// Runs handed out beyond the last line delivered, for each thread: a slow run holds back no more lines than these.
const AHEAD: u64 = 64;

/// Whether to go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flow {
    /// Further runs.
    Continue,
    /// No more.
    Stop,
}

/// Makes the runs of `range` on `jobs` threads, at least 1, and gives `sink` their lines of CSV in the order of their numbers,
/// whatever order they end in. Returns whether all were made: `sink` may stop.
///
/// # Errors
/// The system starts no thread at all.
pub fn execute(
    sweep: &Sweep,
    range: Range<u64>,
    jobs: usize,
    commit: &str,
    sink: &mut dyn FnMut(u64, &str) -> Flow,
) -> std::io::Result<bool> {
    let (order, orders) = sync_channel::<u64>((AHEAD * jobs as u64) as usize);
    let (done, lines) = channel::<(u64, String)>();
    let orders = Mutex::new(orders);
    scope(|threads| {
        let mut started = Ok(0);
        for _ in 0..jobs.max(1) {
            let (done, orders) = (done.clone(), &orders);
            let work = move || {
                while let Some(index) = next(orders) {
                    if done.send((index, line(sweep, index, commit))).is_err() {
                        break;
                    }
                }
            };
            match (Builder::new().spawn_scoped(threads, work), &mut started) {
                (Ok(_), Ok(count)) => *count += 1,
                // Fewer threads are slower, and no failure.
                (Err(_), Ok(1..)) => break,
                (Err(error), started) => *started = Err(error),
                (Ok(_), Err(_)) => {}
            }
        }
        drop(done);
        let out = started.map(|count: u64| deliver(range, count * AHEAD, order, &lines, sink));
        // What is not yet begun is dropped, so that a stop ends at once.
        let orders = orders.lock().unwrap_or_else(PoisonError::into_inner);
        while orders.try_recv().is_ok() {}
        out
    })
}

fn next(orders: &Mutex<Receiver<u64>>) -> Option<u64> {
    orders.lock().unwrap_or_else(PoisonError::into_inner).recv().ok()
}

/// Hands out numbers in order, no more than `most` beyond the last line delivered, and puts the lines in order.
fn deliver(
    range: Range<u64>,
    most: u64,
    order: SyncSender<u64>,
    lines: &Receiver<(u64, String)>,
    sink: &mut dyn FnMut(u64, &str) -> Flow,
) -> bool {
    let mut waiting: BTreeMap<u64, String> = BTreeMap::new();
    let (mut ordered, mut delivered) = (range.start, range.start);
    while delivered < range.end {
        while ordered < range.end && ordered - delivered < most {
            if order.send(ordered).is_err() {
                return false;
            }
            ordered += 1;
        }
        let Ok((index, line)) = lines.recv() else { return false };
        waiting.insert(index, line);
        while let Some(line) = waiting.remove(&delivered) {
            if sink(delivered, &line) == Flow::Stop {
                return false;
            }
            delivered += 1;
        }
    }
    true
}

fn line(sweep: &Sweep, index: u64, commit: &str) -> String {
    let run = sweep.run(index);
    let outcome = catch_unwind(AssertUnwindSafe(|| sweep.simulate(&run)));
    // A defect of the simulator costs one run, not all others.
    let outcome = outcome.unwrap_or_else(|_| {
        Err(BadInput::new("simulator", "it panicked")
            .found(format!("run {index}"))
            .expected("a result")
            .next("report it"))
    });
    sweep.csv_line(&run, &outcome, commit)
}
