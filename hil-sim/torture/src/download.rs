//! A host on the bus that downloads the application to a board, as `xtask download` does.

use std::sync::OnceLock;

use tater_f103::map::APPLICATION;
use tater_wire::Node as Id;
use tater_wire::download::{Downloader, Next};
use tater_wire::tek::{Encoder, end};

use super::fault::Subject;
use super::session::Session;
use hil_world::node::placeholder_application;

/// Patience of the host, ms.
const MOST_MS: u64 = 6_000;

/// The application as a file.
pub fn file() -> &'static [u8] {
    static FILE: OnceLock<Vec<u8>> = OnceLock::new();
    FILE.get_or_init(|| {
        let image = placeholder_application();
        let mut text = Vec::new();
        for line in Encoder::new(APPLICATION.start, &image).into_iter().flatten() {
            text.extend_from_slice(line.as_bytes());
        }
        text.extend_from_slice(end(APPLICATION.start).as_bytes());
        text
    })
}

/// Downloads to a board; gives up after a while, or when the program ends. Returns whether the board has the application.
pub fn run<S: Subject>(session: &mut Session<'_, S>, node: Id) -> bool {
    session.hand.bus_mut().tap(true);
    let mut downloader = Downloader::new(node, file(), session.hand.now_us());
    let end_ms = session.ms() + MOST_MS;
    let mut done = false;
    while session.ms() < end_ms && session.is_whole() {
        let now_us = session.hand.now_us();
        while let Some(stamped) = session.hand.bus_mut().tapped() {
            downloader.receive(&stamped.frame, now_us);
        }
        match downloader.next(now_us) {
            Next::Send(frame) => {
                session.hand.bus_mut().intrude(frame);
                continue;
            }
            Next::Wait(_) => session.step(),
            Next::Done => {
                done = true;
                break;
            }
            Next::Failed(_) => break,
        }
    }
    session.hand.bus_mut().tap(false);
    done
}
