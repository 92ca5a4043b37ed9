//! The WT901C's bytes: frames and samples, commands as the module hears them, RS485 requests and replies.
#![no_main]

use std::path::Path;

use evac_formats::wt901c::modbus::{MAX_REGISTERS, ReplyParser, Request};
use evac_formats::wt901c::{CommandParser, FRAME_BYTES, Parser, Scales, Wt901cReader, encode_words};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let (mut parser, mut frames) = (Parser::default(), 0);
    for frame in bytes.iter().filter_map(|byte| parser.push(*byte)) {
        let at = frame.offset as usize;
        assert_eq!(bytes.get(at..at + FRAME_BYTES), Some(encode_words(frame.id, frame.words()).as_slice()));
        let _ = frame.reading(&Scales::default());
        frames += 1;
    }
    assert_eq!(frames * FRAME_BYTES + parser.pending() + parser.skipped() as usize, bytes.len());

    let mut reader = Wt901cReader::new(bytes, Path::new("fuzz"));
    while let Ok(Some(_)) = reader.next_sample() {}

    let mut commands = CommandParser::default();
    for command in bytes.iter().filter_map(|byte| commands.push(*byte)) {
        assert!(bytes.windows(5).any(|window| window == command.bytes()));
    }

    let [count, rest @ ..] = bytes else { return };
    let mut replies = ReplyParser::new(0x50, usize::from(*count) % (MAX_REGISTERS + 2));
    let found = rest.iter().filter_map(|byte| replies.push(*byte)).count();
    assert!(found * 5 + replies.skipped() as usize <= rest.len());
    for window in rest.windows(8) {
        let window: [u8; 8] = window.try_into().unwrap();
        if let Some(request) = Request::parse(&window, 0x50) {
            assert_eq!(request.bytes(0x50), window);
        }
    }
});
