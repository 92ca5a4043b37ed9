//! Histories of instances that are swapped, killed and lossy, read in every order that shared memory allows.

use evac_frames::{Health, Route, route_flags};
use proptest::prelude::*;

use super::{Gate, MAX_EARLY};
use crate::InputCounters;

const SERVICE: &str = "odometry/pose";

/// What happens, in the order in which it happens.
#[derive(Debug, Clone, Copy)]
enum Event {
    Route(Route),
    /// A frame reaches the reader's queue of this instance.
    Frame {
        seq: u64,
        epoch: u32,
    },
}

fn route(generation: u64, epoch: u32, from_seq: u64, flags: u32) -> Event {
    let (stage, service) = (Health::text("lio"), Health::text(SERVICE));
    Event::Route(Route { stage, service, generation, from_seq, epoch, flags })
}

/// How one instance ends and the next takes over.
#[derive(Debug, Clone, Copy)]
struct Change {
    /// Frames that the old one puts out.
    frames: u64,
    killed: bool,
    /// Of a killed one: whether its last frame reached the reader, and whether it reached the standby.
    reached: (bool, bool),
}

/// The history of these changes and the number of frames in it.
fn history(changes: &[Change], rest: u64) -> (Vec<Event>, u64) {
    let (mut events, mut seq, mut generation) = (Vec::new(), 0, 0);
    for (epoch, change) in (0u32..).zip(changes) {
        let end = seq + change.frames;
        let (reader, standby) = change.reached;
        for frame in seq..end {
            if frame + 1 < end || !change.killed || reader {
                events.push(Event::Frame { seq: frame, epoch });
            }
        }
        generation += 1;
        if change.killed {
            events.push(route(generation, epoch + 1, 0, route_flags::ALONE));
            // The standby repeats the last frame it got and computes the next.
            let followed = if standby { end } else { end - 1 };
            if followed > seq {
                events.push(Event::Frame { seq: followed - 1, epoch: epoch + 1 });
            }
            seq = followed;
        } else {
            events.push(route(generation, epoch + 1, end, 0));
            generation += 1;
            events.push(route(generation, epoch + 1, end, route_flags::ALONE));
            seq = end;
        }
    }
    let epoch = changes.len() as u32;
    events.extend((seq..seq + rest).map(|seq| Event::Frame { seq, epoch }));
    let newest = events.iter().filter_map(|event| match event {
        Event::Frame { seq, .. } => Some(*seq + 1),
        Event::Route(_) => None,
    });
    let frames = newest.max().unwrap_or(0);
    (events, frames)
}

/// Reads as the run loop does: the routes that have come, then the frames, of several instances in any order. `glances` are how
/// many events have happened by then; frames may be newer than the newest route by `ahead`.
fn read(events: &[Event], glances: &[(usize, usize, u64)]) -> (Vec<u64>, InputCounters) {
    let mut gate = Gate::new(SERVICE);
    let mut input = InputCounters::default();
    let mut read = Vec::new();
    let (mut routed, mut taken) = (0, 0);
    // A reader that is farther behind than a gate holds has lost frames anyway.
    let rest = [(MAX_EARLY / 2, 0, 1); 20];
    let mut now = 0;
    for &(step, ahead, order) in glances.iter().chain(&rest) {
        now = (now + step).min(events.len());
        for event in &events[routed..now] {
            if let Event::Route(route) = event {
                gate.route(route);
            }
        }
        routed = now;
        let until = (now + ahead).min(events.len()).max(taken);
        let mut frames: Vec<_> = events[taken..until]
            .iter()
            .filter_map(|event| match event {
                Event::Frame { seq, epoch } => Some((*seq, *epoch)),
                Event::Route(_) => None,
            })
            .collect();
        taken = until;
        // Each instance's frames stay in order; which instance comes first is anybody's guess.
        match order % 3 {
            0 => frames.sort_by_key(|(_, epoch)| *epoch),
            1 => frames.sort_by_key(|(_, epoch)| std::cmp::Reverse(*epoch)),
            _ => {}
        }
        for (seq, epoch) in frames {
            read.extend(gate.offer(seq, epoch, seq, &mut input));
        }
        while let Some(seq) = gate.pop(&mut input) {
            read.push(seq);
        }
    }
    (read, input)
}

fn changes() -> impl Strategy<Value = Vec<Change>> {
    let change = (1u64..12, any::<bool>(), any::<(bool, bool)>())
        .prop_map(|(frames, killed, reached)| Change { frames, killed, reached });
    proptest::collection::vec(change, 0..5)
}

fn glances() -> impl Strategy<Value = Vec<(usize, usize, u64)>> {
    proptest::collection::vec((0usize..12, 0usize..3, 0u64..3), 0..40)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, ..ProptestConfig::default() })]

    #[test]
    fn every_frame_comes_once_and_in_order_however_instances_change(
        changes in changes(), rest in 0u64..12, glances in glances(),
    ) {
        // The frame of a killed instance that reached neither the reader nor the standby comes from the standby.
        let (events, frames) = history(&changes, rest);
        let (read, input) = read(&events, &glances);
        let expected: Vec<_> = (0..frames).collect();
        // A history that ends with a change may leave the last frame to a writer that says nothing more.
        prop_assert!(expected.starts_with(&read), "{read:?}");
        prop_assert!(read.len() as u64 + 1 >= frames, "{read:?} of {frames}");
        if rest > 0 {
            prop_assert_eq!(read.len() as u64, frames);
        }
        prop_assert_eq!((input.lost, input.late), (0, 0));
    }

    #[test]
    fn an_instance_that_dies_of_its_first_frames_gives_way_to_the_one_that_it_had_replaced(
        before in 1u64..12, short in 0u64..6, after in 1u64..30, again in any::<bool>(), glances in glances(),
    ) {
        // The younger epoch is replaced by an older one, which repeats what the younger had put out.
        let mut events: Vec<_> = (0..before).map(|seq| Event::Frame { seq, epoch: 0 }).collect();
        events.push(route(1, 1, before, 0));
        events.extend((before..before + short).map(|seq| Event::Frame { seq, epoch: 1 }));
        events.push(route(2, 0, 0, route_flags::ALONE));
        let mut end = before + short + after;
        events.extend((before..end).map(|seq| Event::Frame { seq, epoch: 0 }));
        if again {
            events.push(route(3, 2, end, 0));
            events.extend((end..end + 5).map(|seq| Event::Frame { seq, epoch: 2 }));
            end += 5;
        }
        let (read, input) = read(&events, &glances);
        prop_assert_eq!(read, (0..end).collect::<Vec<_>>());
        prop_assert_eq!((input.lost, input.late), (0, 0));
    }

    #[test]
    fn what_a_full_buffer_lost_is_counted_and_nothing_waits_for_it(
        changes in changes(), rest in 3u64..12, glances in glances(), keep in proptest::collection::vec(0u8..5, 120),
    ) {
        let (events, frames) = history(&changes, rest);
        let is_last = |event: &Event| matches!(event, Event::Frame { seq, .. } if *seq + 1 == frames);
        let kept: Vec<_> = events
            .iter()
            .zip(keep.iter().cycle())
            .filter(|(event, keep)| matches!(event, Event::Route(_)) || **keep > 0 || is_last(event))
            .map(|(event, _)| *event)
            .collect();
        let (read, input) = read(&kept, &glances);
        prop_assert!(read.windows(2).all(|pair| pair[0] < pair[1]), "{:?}", read);
        prop_assert_eq!(read.last().copied(), Some(frames - 1));
        let first = read[0];
        prop_assert_eq!(read.len() as u64 + input.lost, frames - first);
        prop_assert_eq!(input.late, 0);
    }
}

#[test]
fn an_instance_that_nobody_routed_is_held_back_and_then_followed_from_where_it_counts() {
    let (mut gate, mut input) = (Gate::new(SERVICE), InputCounters::default());
    let mut read = Vec::new();
    for seq in 0..500 {
        read.extend(gate.offer(seq, 0, seq, &mut input));
        read.extend(gate.pop(&mut input));
    }
    assert_eq!(read.len(), 500);
    // It was started anew and counts from zero.
    read.clear();
    for seq in 0..40 {
        read.extend(gate.offer(seq, 1, seq, &mut input));
        while let Some(seq) = gate.pop(&mut input) {
            read.push(seq);
        }
    }
    assert!(read.len() as u64 >= 40 - MAX_EARLY as u64, "{read:?}");
    assert!(read.windows(2).all(|pair| pair[1] == pair[0] + 1), "{read:?}");
    assert_eq!(read.first(), Some(&0));
    assert_eq!((input.lost, input.late), (0, 0));
}

#[test]
fn a_stage_that_joins_after_a_swap_starts_with_what_comes() {
    let (mut gate, mut input) = (Gate::new(SERVICE), InputCounters::default());
    let Event::Route(route) = route(7, 3, 100, route_flags::ALONE) else { return };
    gate.route(&route);
    let mut read = Vec::new();
    for seq in 250..260 {
        read.extend(gate.offer(seq, 3, seq, &mut input));
        read.extend(gate.pop(&mut input));
    }
    assert_eq!(read, (250..260).collect::<Vec<_>>());
    assert_eq!((input.lost, input.late), (0, 0));
}

#[test]
fn one_instance_s_gaps_and_repetitions_are_counted() {
    let (mut gate, mut input) = (Gate::new(SERVICE), InputCounters::default());
    let mut read = Vec::new();
    for seq in [4, 4, 7, 6] {
        read.extend(gate.offer(seq, 0, seq, &mut input));
        read.extend(gate.pop(&mut input));
    }
    assert_eq!(read, [4, 7]);
    assert_eq!((input.lost, input.late), (2, 2));
}
