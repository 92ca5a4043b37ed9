//! Control frames, commands, answers and key lists of both of Livox's protocols: what is read is written back as it was.
#![no_main]

use evac_formats::livox_sdk1::{Frames, Reply, Request};
use evac_formats::livox_sdk2::{Frame, HostAddress, Parameters, ParametersWriter, SearchReply, WriteReply};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let mut frames = Frames::new(bytes);
    let (mut used, mut out) = (0, Vec::new());
    for frame in frames.by_ref() {
        frame.encode(&mut out);
        used += out.len();
        payload(frame.set, frame.id, frame.payload);
    }
    assert_eq!(used + frames.skipped(), bytes.len());
    // Past the checksums, which a fuzzer does not find.
    if let [set, id, rest @ ..] = bytes {
        payload(*set, *id, rest);
    }
    let _ = Frame::parse(bytes);
    list(bytes);
});

fn payload(set: u8, id: u8, payload: &[u8]) {
    let mut out = Vec::new();
    if let Some(request) = Request::read(set, id, payload) {
        request.write(&mut out);
        assert_eq!((out.as_slice(), request.code()), (payload, (set, id)));
    }
    out.clear();
    if let Some(reply) = Reply::read(set, id, payload) {
        reply.write(&mut out);
        assert_eq!(out, payload);
    }
}

fn list(data: &[u8]) {
    let mut out = Vec::new();
    if let Some(list) = Parameters::of_request(data).filter(Parameters::is_whole) {
        let mut writer = ParametersWriter::request(&mut out);
        list.for_each(|parameter| writer.put(parameter.key, parameter.value));
        // The reserved word aside.
        assert_eq!((out.get(..2), out.get(4..)), (data.get(..2), data.get(4..)));
    }
    if let Some((code, list)) = Parameters::of_answer(data).filter(|(_, list)| list.is_whole()) {
        let mut writer = ParametersWriter::answer(code, &mut out);
        list.for_each(|parameter| writer.put(parameter.key, parameter.value));
        assert_eq!(out, data);
    }
    assert!(Parameters::keys_of_query(data).count() <= data.len() / 2);
    if let Some(reply) = SearchReply::parse(data) {
        reply.encode(&mut out);
        assert_eq!(out, data[..24]);
    }
    if let Some(reply) = WriteReply::parse(data) {
        assert_eq!(reply.to_bytes(), data[..3]);
    }
    if let Some(address) = HostAddress::parse(data) {
        assert_eq!(address.to_bytes(), data[..8]);
    }
}
