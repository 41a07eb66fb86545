//! The image under a debug probe: its logs, and GDB's remote protocol.

use std::io::{Read, Write};
use std::net::TcpStream;

use board_emu::gdb::{Server, listen};
use board_emu::image::Programs;
use board_emu::rtt::Probe;

use super::bench::{Bench, NODE, flashed, folder, production};
use tater_wire::Property;

/// Only the release image has logs.
fn release() -> Option<Programs> {
    let programs = Programs::load(&folder("release")).ok();
    if programs.is_none() {
        println!("skipped: no image; cargo xtask image --profile release makes it");
    }
    programs
}

#[test]
fn release_image_logs_and_production_image_has_none() {
    let Some(programs) = release() else { return };
    let mut probe = Probe::new(&folder("release").join("tater.elf")).expect("it logs");
    let mut bench = Bench::with(flashed(&programs, NODE));
    let mut said = |bench: &mut Bench| probe.read(bench.board_mut().machine_mut().chip_mut());
    let lines = said(&mut bench);
    assert_eq!(lines.first().map(String::as_str), Some("info Node(4) awake, position trusted: false"));
    assert_eq!(said(&mut bench), Vec::<String>::new(), "each line is read once");
    // VERS is read-only in the application.
    bench.set(Property::VERS, 1);
    bench.wait_ms(5);
    let lines = said(&mut bench);
    assert!(
        lines.len() == 1 && lines[0].contains("Refused { property: Some(0), error: Access(VERS) }"),
        "{lines:?}"
    );
    if folder("production").join("tater.elf").exists() {
        let error = Probe::new(&folder("production").join("tater.elf")).err().expect("it is silent");
        assert!(error.contains("--profile release"), "{error}");
    }
}

struct Gdb(TcpStream);

impl Gdb {
    fn send(&mut self, packet: &str) {
        let sum = packet.bytes().fold(0u8, u8::wrapping_add);
        write!(self.0, "${packet}#{sum:02x}").expect("connected");
    }

    fn byte(&mut self) -> u8 {
        let mut byte = [0];
        self.0.read_exact(&mut byte).expect("connected");
        byte[0]
    }

    /// Text of the next packet, acknowledged, with run lengths expanded.
    fn packet(&mut self) -> String {
        while self.byte() != b'$' {}
        let mut text = String::new();
        loop {
            match self.byte() {
                b'#' => break,
                b'*' => {
                    let last = text.chars().next_back().expect("something to repeat");
                    let times = self.byte() - 29;
                    text.extend(std::iter::repeat_n(last, times.into()));
                }
                byte => text.push(char::from(byte)),
            }
        }
        let _sum = (self.byte(), self.byte());
        self.0.write_all(b"+").expect("connected");
        text
    }

    fn ask(&mut self, packet: &str) -> String {
        self.send(packet);
        self.packet()
    }

    fn register(&mut self, index: usize) -> u32 {
        let words = self.ask("g");
        u32::from_str_radix(&words[8 * index..8 * index + 8], 16).expect("hexadecimal").swap_bytes()
    }
}

const PC: usize = 15;

#[test]
fn gdb_stops_at_the_tick_steps_and_continues() {
    let Some(programs) = production() else { return };
    let names = std::rc::Rc::clone(&programs.names);
    // The tick's vector: TIM3 is exception 45 (RM0008 table 63).
    let vector = 4 * 45;
    let word = u32::from_le_bytes(programs.application[vector..vector + 4].try_into().expect("four bytes"));
    let tick = word & !1;
    let mut bench = Bench::moving(&programs);
    let before = bench.board().rig().truth().counts;
    let listener = listen(0).expect("a free port");
    let address = listener.local_addr().expect("bound");
    let client = std::thread::spawn(move || {
        let mut gdb = Gdb(TcpStream::connect(address).expect("it listens"));
        assert!(gdb.ask("?").starts_with('S') || gdb.ask("?").starts_with('T'));
        assert!(gdb.ask("qXfer:features:read:target.xml:0,fff").contains("m-profile"));
        assert_eq!(gdb.ask(&format!("Z0,{tick:x},2")), "OK");
        let stop = gdb.ask("c");
        assert!(stop.starts_with("T05"), "{stop}");
        assert_eq!(gdb.register(PC), tick);
        let code = gdb.ask(&format!("m{:x},4", tick));
        assert_eq!(gdb.ask(&format!("z0,{tick:x},2")), "OK");
        let mut places = vec![tick];
        for _ in 0..10 {
            let stop = gdb.ask("s");
            assert!(stop.starts_with('S') || stop.starts_with("T05"), "{stop}");
            places.push(gdb.register(PC));
        }
        gdb.ask("D");
        (code, places)
    });
    let mut server = Server::accept(&listener, bench.board_mut()).expect("a client");
    bench.board_mut().set_runner(Box::new(move |board, until| server.run(board, until)));
    bench.wait_ms(50);
    // The client must not wait forever.
    bench.board_mut().set_runner(Box::new(|board, until| {
        board.run(until, &[]);
    }));
    let (code, places) = client.join().expect("the client's own assertions hold");
    let at = (tick - tater_f103::map::APPLICATION.start) as usize;
    let bytes: String = programs.application[at..at + 4].iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(code, bytes, "memory is the image");
    assert!(places.windows(2).all(|pair| pair[0] != pair[1]), "each step moves it: {places:x?}");
    assert!(names.function(tick).is_some(), "it has a name");
    assert!(bench.board().rig().truth().counts > before + 1.0, "the motor has gone on");
}
