use super::*;
use crate::monitor::download::{DRAIN, FINISHED, GRANT, REPEAT, TIMEOUT};
use proptest::prelude::*;
use tater_wire::download::pack;

/// A board with an old application, and its host.
fn bench() -> (Bench, Vec<u8>) {
    let mut bench = Bench::strapped(3);
    let old = image(3000, 1);
    bench.board().chip.load(APPLICATION.start, &old);
    (bench, old)
}

/// The monitor's requests in this step, in frames; other frames are an error.
fn requests(bench: &mut Bench, us: u32) -> Vec<Frame> {
    assert_eq!(bench.step(us), Next::Stay);
    let sent = std::mem::take(&mut bench.board().sent);
    assert!(sent.iter().all(|frame| frame.raw_id() == 3 << 5 && frame.data()[0] == 0), "{sent:?}");
    sent
}

/// As Barrett's host does it: one character for each request.
fn send_singly(bench: &mut Bench, text: &[u8]) {
    let mut text = text.iter();
    while !bench.monitor.is_idle() {
        for _ in requests(bench, 100) {
            let Some(&character) = text.next() else { return };
            bench.say(3, &[character]);
        }
    }
}

/// A download from beginning to end; returns ERROR after it.
fn download(bench: &mut Bench, text: &[u8], numbered: bool) -> Option<u16> {
    if numbered {
        send_numbered(bench, text, |_| (1, false));
    } else {
        bench.set(3, 0, 0xAA);
        send_singly(bench, text);
    }
    while !bench.monitor.is_idle() {
        requests(bench, 100);
    }
    bench.get(3, 4)
}

fn application(bench: &mut Bench, len: usize) -> Vec<u8> {
    bench.board().chip.image(APPLICATION, len).to_vec()
}

/// Both half-words of the mark are 0: a power cut may leave one of them.
fn staging_is_invalid(bench: &mut Bench) -> bool {
    [0, 2].iter().all(|half| bench.board().chip.half_word(STAGING.start + MAGIC_AT + half) == 0)
}

#[test]
fn one_character_per_request_loads_an_application() {
    let (mut bench, _) = bench();
    let new = image(2 * 1024 + 400, 2);
    assert_eq!(download(&mut bench, &characters(&new), false), Some(0));
    assert_eq!(application(&mut bench, new.len()), new);
    assert!(staging_is_invalid(&mut bench), "no copy is owed any more");
    bench.set(3, 5, 2);
    assert_eq!(bench.settle(), Next::Start);
}

#[test]
fn first_request_follows_the_first_erase_and_repeats() {
    let (mut bench, _) = bench();
    bench.set(3, 0, 0xAA);
    assert_eq!(requests(&mut bench, 1), []);
    assert_eq!(bench.board().chip.erased, [STAGING.start]);
    let request = Frame::from_raw(3 << 5, &[0]).expect("a frame");
    assert_eq!(requests(&mut bench, 1), [request]);
    assert_eq!(requests(&mut bench, REPEAT.0 - 1), []);
    assert_eq!(requests(&mut bench, 1), [request]);
    assert_eq!(requests(&mut bench, REPEAT.0), [request]);
}

#[test]
fn step_with_a_time_before_the_frame_does_not_time_out() {
    let (mut bench, _) = bench();
    bench.set(3, 0, 0xAA);
    while requests(&mut bench, 100).is_empty() {}
    // The interrupt occurs after the loop has read the clock, at the latest time that still counts as early.
    for (late, character) in [1, 2, 1000, 1 << 31].into_iter().zip(characters(&image(1024, 2))) {
        let read = bench.now;
        let frame = Frame::from_raw(3, &[character]).expect("a frame");
        bench.monitor.receive(&frame, Micros(read.wrapping_add(late)));
        assert_eq!(bench.monitor.step(Micros(read)), Next::Stay);
        assert!(matches!(bench.monitor.phase, Phase::Download(_)), "{late}: {:?}", bench.monitor.error());
    }
}

#[test]
fn host_that_dies_leaves_the_old_application() {
    let new = image(2 * 1024, 2);
    let text = characters(&new);
    for gone_after in (0..text.len()).step_by(97) {
        let (mut bench, old) = bench();
        bench.set(3, 0, 0xAA);
        send_singly(&mut bench, &text[..gone_after]);
        let last = bench.now;
        while !bench.monitor.is_idle() {
            requests(&mut bench, 1000);
            assert!(bench.now.wrapping_sub(last) < TIMEOUT.0 + REPEAT.0);
        }
        assert!(bench.now.wrapping_sub(last) >= TIMEOUT.0 - 1000);
        assert_eq!(bench.get(3, 4), Some(u16::from(FaultCode::DownloadTimeout.code())));
        assert_eq!(application(&mut bench, old.len()), old);
        assert!(staging_is_invalid(&mut bench));
        assert_eq!(download(&mut bench, &text, false), Some(0), "downloadable again");
        assert_eq!(application(&mut bench, new.len()), new);
    }
}

#[test]
fn bad_file_raises_its_error_and_leaves_the_old_application() {
    let new = image(2 * 1024, 2);
    let good = characters(&new);
    let start = APPLICATION.start;
    let mut checksum = good.clone();
    checksum[20] ^= 1;
    let mut crc = new.clone();
    crc[1000] ^= 1;
    let mut unsealed = new.clone();
    unsealed[0x1C..0x20].fill(0xFF);
    let mut longer = new.clone();
    longer.extend([0xFF; 4]);
    let twice = [data(start, &new[..32]), data(start + 31, &new[31..40])].concat();
    let cases = [
        (17, b"X0".to_vec(), "no hexadecimal length"),
        (18, checksum, "a character of the data"),
        (19, data(start - 1, &[1, 2]), "below"),
        (19, data(STAGING.start - 1, &[1, 2]), "beyond"),
        (19, record("600F80000000000000001"), "far beyond"),
        (20, twice, "a record begins in the one before"),
        (20, [data(start + 8, &[1]), data(start, &[1])].concat(), "records fall"),
        (22, characters(&crc), "a byte is wrong, its record is not"),
        (22, characters(&unsealed), "not sealed"),
        (22, characters(&longer), "longer than its header says"),
        (22, characters(&new[..new.len() - 4]), "shorter than its header says"),
        (22, termination(), "nothing at all"),
        (23, good[..good.len() - 1].to_vec(), "no termination"),
    ];
    let cases = cases
        .into_iter()
        .flat_map(|(error, text, what)| [(error, text.clone(), what, false), (error, text, what, true)]);
    // One character a request: nobody requests what follows the end.
    let after = [
        (17, [good.clone(), termination()].concat(), "a second termination", true),
        // The first error ends with a frame, and is found when the next frame is processed.
        (17, [record("300AAAAA"), termination().repeat(3)].concat(), "terminations only", true),
    ];
    for (error, text, what, numbered) in cases.chain(after) {
        let (mut bench, old) = bench();
        assert_eq!(download(&mut bench, &text, numbered), Some(error), "{what}");
        assert_eq!(application(&mut bench, old.len()), old, "{what}");
        assert!(staging_is_invalid(&mut bench), "{what}");
        bench.set(3, 5, 2);
        assert_eq!(bench.settle(), Next::Start, "{what}");
        let mut bench = bench.reset();
        assert_eq!(download(&mut bench, &good, !numbered), Some(0), "{what}: downloadable again");
        assert_eq!(application(&mut bench, new.len()), new, "{what}");
    }
}

/// btutil waits for a request of each character of its file, without a time limit and whatever ERROR reads.
#[test]
fn refused_download_of_an_old_host_is_requested_to_its_end() {
    let new = image(2 * 1024, 2);
    let good = characters(&new);
    let start = APPLICATION.start;
    let rest = |bad: Vec<u8>| [bad, good.clone()].concat();
    let mut checksum = good.clone();
    checksum[20] ^= 1;
    let cases = [
        (17, rest(b"X0".to_vec())),
        (18, checksum),
        (19, rest(data(start - 1, &[1, 2]))),
        (20, rest([data(start + 8, &[1]), data(start, &[1])].concat())),
        (21, good.clone()),
    ];
    for (error, text) in cases {
        let (mut bench, old) = bench();
        bench.board().chip.worn = error == 21;
        bench.set(3, 0, 0xAA);
        let (mut sent, mut last) = (0, bench.now);
        while !bench.monitor.is_idle() {
            // Slower than a request is repeated, now and then.
            for _ in requests(&mut bench, if sent % 1000 == 7 { REPEAT.0 + 1 } else { 100 }) {
                if let Some(&character) = text.get(sent) {
                    bench.say(3, &[character]);
                    (sent, last) = (sent + 1, bench.now);
                }
            }
        }
        assert_eq!(sent, text.len(), "ERROR {error}: the host would wait forever");
        let silent = bench.now.wrapping_sub(last);
        assert!((FINISHED.0..FINISHED.0 + 2 * REPEAT.0).contains(&silent), "ERROR {error}: {silent} us");
        assert_eq!(bench.get(3, 4), Some(error));
        assert_eq!(application(&mut bench, old.len()), old);
        bench.board().chip.worn = false;
        assert_eq!(download(&mut bench, &good, false), Some(0), "downloadable again");
    }
}

#[test]
fn refused_download_of_a_host_that_never_ends_is_dropped_after_half_an_hour() {
    let (mut bench, _) = bench();
    bench.set(3, 0, 0xAA);
    let begun = bench.now;
    while !bench.monitor.is_idle() {
        for _ in requests(&mut bench, 500_000) {
            bench.say(3, b"0");
        }
    }
    let took = bench.now.wrapping_sub(begun);
    assert!((DRAIN.0..DRAIN.0 + TIMEOUT.0).contains(&took), "{took}");
    // A new order ends it at once.
    bench.set(3, 0, 0xAA);
    send_singly(&mut bench, b"X0");
    assert!(matches!(bench.monitor.phase, Phase::Download(_)));
    bench.set(3, 0, 0xAA);
    let new = image(1024, 3);
    send_singly(&mut bench, &characters(&new));
    assert_eq!((bench.settle(), bench.get(3, 4)), (Next::Stay, Some(0)));
}

#[test]
fn worn_out_flash_raises_flash_write() {
    let (mut bench, old) = bench();
    bench.board().chip.worn = true;
    let text = characters(&image(2048, 2));
    assert_eq!(download(&mut bench, &text, false), Some(u16::from(FaultCode::FlashWrite.code())));
    assert_eq!(bench.monitor.error(), Some(FaultCode::FlashWrite));
    assert_eq!(application(&mut bench, old.len()), old);
}

#[test]
fn paused_host_sends_what_it_owes_before_the_next_erase() {
    let new = image(3 * 1024, 2);
    let text = characters(&new);
    let (mut bench, _) = bench();
    bench.set(3, 0, 0xAA);
    let (mut sent, mut owed, mut most) = (0, 0, 0);
    while !bench.monitor.is_idle() {
        let erased = bench.board().chip.erased.len();
        owed += requests(&mut bench, 1000).len();
        let erased = bench.board().chip.erased.len() > erased;
        assert!(!erased || owed == 0 || sent == text.len(), "erased at {sent}, {owed} owed");
        // Once in 50 characters the host is busy for 8 s; the board repeats its request and gets an answer to each.
        if sent % 50 == 5 && owed < 40 {
            continue;
        }
        most = most.max(owed);
        if owed > 0 && sent < text.len() {
            bench.say(3, &text[sent..=sent]);
            (sent, owed) = (sent + 1, owed - 1);
        }
    }
    assert_eq!((bench.get(3, 4), most), (Some(0), 40));
    assert_eq!(application(&mut bench, new.len()), new);
}

#[test]
fn lost_request_costs_one_repeat() {
    let text = characters(&image(1024, 2));
    let (mut bench, _) = bench();
    bench.set(3, 0, 0xAA);
    let (mut sent, mut asked) = (0, 0);
    let begun = bench.now;
    while !bench.monitor.is_idle() {
        for _ in requests(&mut bench, 100) {
            asked += 1;
            if asked % 100 != 0 && sent < text.len() {
                bench.say(3, &text[sent..=sent]);
                sent += 1;
            }
        }
    }
    assert_eq!((bench.get(3, 4), sent), (Some(0), text.len()));
    // Each hundredth was lost: one repeat, and one more because the board cannot know that no answer will come.
    assert!(asked * 97 / 100 < text.len() && asked > text.len(), "{asked} for {}", text.len());
    let took = bench.now.wrapping_sub(begun);
    // Two timeouts for each, and below two steps for a character, a half-word each and the copy.
    assert!(took < 2 * REPEAT.0 * (asked as u32).div_ceil(100) + 200 * text.len() as u32, "{took}");
}

/// Our own host on a bus where `lose` decides, for the nth frame sent, how often it arrives and whether late.
fn send_numbered(bench: &mut Bench, text: &[u8], lose: impl Fn(usize) -> (usize, bool)) -> (usize, usize) {
    bench.set(3, 0, 0x1AA);
    let (mut asked, mut count) = (0, 0);
    let mut late: Vec<[u8; 8]> = Vec::new();
    while !bench.monitor.is_idle() {
        for request in requests(bench, 60) {
            let &[0, GRANT, a, b, c] = request.data() else { panic!("{request:?}") };
            let from = u32::from_le_bytes([a, b, c, 0]) as usize;
            asked += 1;
            for frame in std::mem::take(&mut late) {
                bench.say(3, &frame);
            }
            for (i, eight) in text.chunks(8).enumerate().skip(from / 8).take(usize::from(GRANT)) {
                let (times, delayed) = lose(count);
                count += 1;
                let frame = pack((i % 256) as u8, eight);
                if delayed {
                    late.push(frame);
                } else {
                    (0..times).for_each(|_| drop(bench.say(3, &frame)));
                }
                requests(bench, 130);
            }
        }
    }
    (asked, count)
}

#[test]
fn numbered_frames_load_an_application() {
    let (mut bench, _) = bench();
    let new = image(5000, 2);
    let text = characters(&new);
    let (asked, frames) = send_numbered(&mut bench, &text, |_| (1, false));
    assert_eq!(application(&mut bench, new.len()), new);
    assert_eq!(frames, text.len().div_ceil(8), "none is sent twice");
    assert_eq!(asked, frames.div_ceil(usize::from(GRANT)));
}

#[test]
fn next_grant_is_requested_as_soon_as_there_is_room_for_it() {
    let (mut bench, _) = bench();
    let text = characters(&image(5000, 2));
    let mut frames = (0..).zip(text.chunks(8)).map(|(number, eight)| pack(number, eight));
    bench.set(3, 0, 0x1AA);
    assert!((0..10).any(|_| !requests(&mut bench, 100).is_empty()));
    frames.by_ref().take(GRANT.into()).for_each(|frame| drop(bench.say(3, &frame)));
    // Of 128 characters one record is decoded; the ring has room for 128 more.
    let [a, b, c, _] = (u32::from(GRANT) * 8).to_le_bytes();
    assert_eq!(requests(&mut bench, 100), [Frame::from_raw(3 << 5, &[0, GRANT, a, b, c]).expect("a frame")]);
    frames.by_ref().take(GRANT.into()).for_each(|frame| drop(bench.say(3, &frame)));
    assert_eq!(requests(&mut bench, 100), [], "no room yet");
}

#[test]
fn staging_is_erased_page_by_page_before_it_is_written() {
    let (mut bench, _) = bench();
    // Remains of another download: what is not erased cannot be programmed.
    bench.board().chip.load(STAGING.start, &[0x55; 4 * PAGE as usize]);
    let new = image(2 * PAGE as usize, 2);
    // Records that end where no page does.
    let mut text = Vec::new();
    for (address, bytes) in (APPLICATION.start..).step_by(30).zip(new.chunks(30)) {
        text.extend(data(address, bytes));
    }
    text.extend(termination());
    assert_eq!(download(&mut bench, &text, false), Some(0));
    assert_eq!(application(&mut bench, new.len()), new);
    let pages =
        [MAP.page(STAGING, 0), MAP.page(STAGING, 1), MAP.page(APPLICATION, 0), MAP.page(APPLICATION, 1)];
    assert_eq!(bench.board().chip.erased, pages, "as many as the image needs");
}

#[test]
fn lost_late_or_duplicated_numbered_frames_do_no_harm() {
    let new = image(5000, 2);
    let text = characters(&new);
    for every in [2, 3, 7, 16, 17, 50] {
        for (times, late) in [(0, false), (2, false), (3, false), (1, true)] {
            let (mut bench, _) = bench();
            // Scattered: at even distances the first frame of every grant could be the lost one.
            let struck = |n: usize| (n as u32).wrapping_mul(2_654_435_761) >> 8;
            let lose = |n| if struck(n) % every == 0 { (times, late) } else { (1, false) };
            send_numbered(&mut bench, &text, lose);
            assert_eq!(bench.get(3, 4), Some(0), "every {every}th {times} times, late {late}");
            assert_eq!(application(&mut bench, new.len()), new);
        }
    }
}

#[test]
fn host_beyond_its_grant_is_asked_again() {
    let new = image(5000, 2);
    let text = characters(&new);
    let (mut bench, _) = bench();
    bench.set(3, 0, 0x1AA);
    while !bench.monitor.is_idle() {
        for request in requests(&mut bench, 60) {
            let &[0, GRANT, a, b, c] = request.data() else { panic!("{request:?}") };
            let from = u32::from_le_bytes([a, b, c, 0]) as usize / 8;
            for (i, eight) in text.chunks(8).enumerate().skip(from).take(40) {
                bench.say(3, &pack((i % 256) as u8, eight));
            }
        }
    }
    assert_eq!((bench.get(3, 4), application(&mut bench, new.len())), (Some(0), new));
}

#[test]
fn failed_copy_stays_owed() {
    let (mut bench, _) = bench();
    let new = image(4000, 2);
    bench.board().chip.load(STAGING.start, &new);
    bench.board().chip.worn = true;
    let mut bench = bench.reset();
    let failed = Some(u16::from(FaultCode::FlashWrite.code()));
    assert_eq!((bench.settle(), bench.get(3, 4)), (Next::Stay, failed));
    bench.set(3, 5, 2);
    assert_eq!((bench.settle(), bench.get(3, 4)), (Next::Stay, failed), "tried again");
    bench.board().chip.worn = false;
    bench.set(3, 5, 2);
    assert_eq!((bench.settle(), application(&mut bench, new.len())), (Next::Start, new));
}

#[test]
fn repeatedly_failing_copy_does_not_block_a_download() {
    let (mut bench, _) = bench();
    bench.board().chip.load(STAGING.start, &image(4000, 2));
    bench.board().chip.worn = true;
    let mut bench = bench.reset();
    bench.settle();
    bench.set(3, 0, 0xAA);
    while matches!(bench.monitor.phase, Phase::Check(..) | Phase::Copy(_)) {
        requests(&mut bench, 100);
    }
    bench.board().chip.worn = false;
    let new = image(3000, 3);
    send_singly(&mut bench, &characters(&new));
    assert_eq!((bench.settle(), bench.get(3, 4)), (Next::Stay, Some(0)));
    assert_eq!(application(&mut bench, new.len()), new);
}

#[test]
fn owed_copy_is_retried_before_a_download_erases_staging() {
    for mended in [true, false] {
        let (mut bench, _) = bench();
        let owed = image(4000, 2);
        bench.board().chip.load(STAGING.start, &owed);
        bench.board().chip.worn = true;
        let mut bench = bench.reset();
        assert!(bench.monitor.is_checking());
        while !matches!(bench.monitor.phase, Phase::Copy(_)) {
            requests(&mut bench, 100);
        }
        assert!(!bench.monitor.is_checking());
        bench.set(3, 0, 0xAA);
        let copies = |bench: &mut Bench| {
            bench.board().chip.erased.iter().filter(|page| **page == APPLICATION.start).count()
        };
        while copies(&mut bench) < 2 && !matches!(bench.monitor.phase, Phase::Download(_)) {
            requests(&mut bench, 100);
        }
        assert_eq!(copies(&mut bench), 2, "tried again");
        bench.board().chip.worn = !mended;
        while !matches!(bench.monitor.phase, Phase::Download(_)) {
            requests(&mut bench, 100);
        }
        assert_eq!(application(&mut bench, owed.len()) == owed, mended);
        assert_eq!(copies(&mut bench), 2, "then it is the download's turn");
        bench.board().chip.worn = false;
        let new = image(3000, 3);
        send_singly(&mut bench, &characters(&new));
        assert_eq!((bench.settle(), bench.get(3, 4)), (Next::Stay, Some(0)));
        assert_eq!(application(&mut bench, new.len()), new);
    }
}

#[test]
fn get_is_answered_during_a_download_and_set_stat_ends_it() {
    let text = characters(&image(2048, 2));
    let (mut bench, old) = bench();
    bench.set(3, 0, 0xAA);
    send_singly(&mut bench, &text[..1000]);
    assert_eq!((bench.get(3, 5), bench.get(3, 4)), (Some(0), Some(0)));
    bench.set(3, 5, 0);
    assert_eq!((bench.settle(), bench.get(3, 4)), (Next::Stay, Some(0)), "ended, no fault");
    assert_eq!(bench.board().resets, 1, "a reset, as in the application");
    bench.set(3, 0, 0xAA);
    send_singly(&mut bench, &text[..1000]);
    assert_eq!(download(&mut bench, &text, false), Some(0), "begun anew");
    bench.board().chip.load(APPLICATION.start, &old);
    bench.set(3, 0, 0xAA);
    send_singly(&mut bench, &text[..1000]);
    bench.set(3, 5, 2);
    assert_eq!((bench.settle(), application(&mut bench, old.len())), (Next::Start, old));
}

#[test]
fn start_request_survives_check_and_copy_but_no_fault() {
    for good in [true, false] {
        let (mut bench, old) = bench();
        let mut new = image(2048, 2);
        new[100] ^= u8::from(!good);
        bench.set(3, 0, 0xAA);
        let text = characters(&new);
        send_singly(&mut bench, &text[..text.len() - 1]);
        bench.say(3, &text[text.len() - 1..]);
        while matches!(bench.monitor.phase, Phase::Download(_)) {
            requests(&mut bench, 100);
        }
        bench.set(3, 5, 2);
        let (next, error, application) = if good { (Next::Start, 0, new) } else { (Next::Stay, 22, old) };
        assert_eq!((bench.settle(), bench.get(3, 4)), (next, Some(error)));
        assert_eq!(super::download::application(&mut bench, application.len()), application);
    }
}

#[test]
fn owed_copy_is_made_at_boot_and_before_a_start() {
    for asked in [false, true] {
        let (mut bench, _) = bench();
        let new = image(4000, 2);
        bench.board().chip.load(STAGING.start, &new);
        if asked {
            bench.set(3, 5, 2);
            assert_eq!(bench.settle(), Next::Start);
        } else {
            bench = bench.reset();
            assert_eq!(bench.settle(), Next::Stay);
        }
        assert_eq!(application(&mut bench, new.len()), new);
        assert!(staging_is_invalid(&mut bench));
    }
}

#[test]
fn download_is_accepted_only_from_the_host_to_the_own_node() {
    let (mut bench, _) = bench();
    for id in [0x400, 0x401, 0x404, 1 << 5 | 3, 2] {
        bench.say(id, &[0x80, 0, 0xAA, 0]);
        assert_eq!((bench.settle(), bench.board().chip.erased.len()), (Next::Stay, 0), "{id:#x}");
    }
}

proptest! {
    /// An image cut into any records, with bytes of 0xFF left out: odd addresses, odd lengths, gaps.
    #[test]
    fn any_rising_records_build_the_image(
        blank in 60usize..3000, gap in 0usize..1500, cuts in prop::collection::vec(1usize..=120, 20..200),
    ) {
        let mut new = image(4096, 2);
        let end = (blank + gap).min(4096 - 4);
        new[blank.min(end)..end].fill(0xFF);
        seal(&mut new, 2, &MAP).expect("an application's image");
        let (mut text, mut at) = (Vec::new(), 0);
        for cut in cuts.into_iter().cycle() {
            while at < end && at >= blank {
                at += 1;
            }
            let to = (at + cut).min(new.len()).min(if at < blank { blank } else { new.len() });
            text.extend(data(APPLICATION.start + at as u32, &new[at..to]));
            at = to;
            if at == new.len() {
                break;
            }
        }
        text.extend(termination());
        let (mut bench, _) = bench();
        send_numbered(&mut bench, &text, |_| (1, false));
        prop_assert_eq!(bench.get(3, 4), Some(0));
        prop_assert_eq!(application(&mut bench, new.len()), new.clone());
        prop_assert!(tater_wire::image::Header::verify(&new, &MAP).is_ok());
    }
}
