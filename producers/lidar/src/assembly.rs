//! Packets into scans, without sockets and clocks: whole packets, by the device's time.

use crate::store::Slot;

/// A packet of a scan that is being put together.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Held {
    pub(crate) slot: Slot,
    /// Time of its first shot after the scan's start, nanoseconds.
    pub(crate) offset_ns: i64,
}

/// A packet, as far as it matters here.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Arrived {
    pub(crate) slot: Slot,
    /// Time of the first shot on the device's line, nanoseconds.
    pub(crate) place_ns: i64,
    /// Time of all its shots, nanoseconds.
    pub(crate) length_ns: i64,
    pub(crate) points: usize,
    pub(crate) arrival_ns: i64,
}

/// A scan's packets.
#[derive(Debug, Default)]
pub(crate) struct Scan {
    pub(crate) packets: Vec<Held>,
    /// Start on the device's line, nanoseconds.
    pub(crate) start_ns: i64,
    /// End, which is where the next one starts.
    pub(crate) end_ns: i64,
    pub(crate) points: usize,
    /// Packets that did not come.
    pub(crate) lost: u32,
    /// Host time at which the newest packet came.
    pub(crate) arrival_ns: i64,
}

/// Puts scans together. Scan `k` is the whole packets of which most lies in `[k P, (k + 1) P)` of the device's clock, P being
/// the period; it is complete with its last packet, without waiting for the next scan's first.
#[derive(Debug)]
pub(crate) struct Assembly {
    period_ns: i64,
    most_points: usize,
    most_packets: usize,
    scan: Scan,
    /// Whether `scan` has begun, and its number.
    open: bool,
    number: i64,
    /// Where the next packet starts if none is lost.
    expected_ns: Option<i64>,
    length_ns: i64,
    /// Packets lost in all.
    pub(crate) lost: u64,
}

impl Assembly {
    pub(crate) fn new(period_ns: i64, most_points: usize, most_packets: usize) -> Self {
        let scan = Scan { packets: Vec::with_capacity(most_packets), ..Scan::default() };
        Self {
            period_ns,
            most_points,
            most_packets,
            scan,
            open: false,
            number: 0,
            expected_ns: None,
            length_ns: 0,
            lost: 0,
        }
    }

    /// Whether a scan must be taken before this packet is added: it does not belong to it, or does not fit.
    pub(crate) fn is_complete_before(&self, packet: &Arrived) -> bool {
        let late = self.scan_of(packet.place_ns, packet.length_ns) != self.number;
        let full = self.scan.points + packet.points > self.most_points
            || self.scan.packets.len() == self.most_packets;
        self.open && (late || full)
    }

    /// Whether a packet is left out because nothing is known of what was before it and its scan has begun already.
    pub(crate) fn is_too_early(&self, packet: &Arrived) -> bool {
        let begins = self.scan_of(packet.place_ns, packet.length_ns)
            != self.scan_of(packet.place_ns - packet.length_ns, packet.length_ns);
        !self.open && self.expected_ns.is_none() && !begins
    }

    /// Whether a packet comes after its scan was given up: it is counted as lost already, and its scan was passed on.
    pub(crate) fn is_too_late(&self, packet: &Arrived) -> bool {
        let middle_ns = packet.place_ns + packet.length_ns / 2;
        !self.open && self.expected_ns.is_some_and(|expected_ns| middle_ns < expected_ns)
    }

    /// Adds a packet; whether the scan is complete with it.
    pub(crate) fn add(&mut self, packet: &Arrived) -> bool {
        let missing = self.missing_before(packet.place_ns, packet.length_ns);
        self.lost += u64::from(missing);
        let within_scan = self.open || i64::from(missing) * packet.length_ns < self.period_ns;
        if !self.open {
            self.begin(packet, within_scan && missing > 0);
        }
        if within_scan {
            self.scan.lost = self.scan.lost.saturating_add(missing);
        }
        self.scan.packets.push(Held { slot: packet.slot, offset_ns: packet.place_ns - self.scan.start_ns });
        self.scan.points += packet.points;
        self.scan.arrival_ns = packet.arrival_ns;
        self.length_ns = packet.length_ns;
        self.scan.end_ns = packet.place_ns + packet.length_ns;
        self.expected_ns = Some(self.scan.end_ns);
        self.scan_of(self.scan.end_ns, packet.length_ns) != self.number
    }

    /// Number of the scan that a packet belongs to.
    fn scan_of(&self, place_ns: i64, length_ns: i64) -> i64 {
        (place_ns + length_ns / 2).div_euclid(self.period_ns)
    }

    /// The scan that has begun, which ends with it. Its packets stay valid until `recycle`.
    pub(crate) fn take(&mut self) -> Scan {
        self.open = false;
        std::mem::take(&mut self.scan)
    }

    /// Gives a scan's memory back, to be used for the next.
    pub(crate) fn recycle(&mut self, mut scan: Scan) {
        scan.packets.clear();
        self.scan = Scan { packets: scan.packets, ..Scan::default() };
    }

    /// When on the device's line the scan that has begun should end.
    pub(crate) fn due_ns(&self) -> Option<i64> {
        self.open.then_some((self.number + 1) * self.period_ns)
    }

    /// No packet has come until `place_ns`, where there should have been some: they are lost.
    pub(crate) fn give_up(&mut self, place_ns: i64) {
        let missing = self.missing_before(place_ns, self.length_ns);
        self.scan.lost = self.scan.lost.saturating_add(missing);
        self.lost += u64::from(missing);
        self.scan.end_ns += i64::from(missing) * self.length_ns;
        self.expected_ns = self.open.then_some(self.scan.end_ns);
    }

    /// The device's line begins anew: no packet is missing before the next.
    pub(crate) fn forget_expected(&mut self) {
        self.expected_ns = None;
    }

    /// The scan begins with its first packet, or where the one before has ended if some are missing between.
    fn begin(&mut self, packet: &Arrived, some_missing: bool) {
        let start_ns = self.expected_ns.filter(|_| some_missing).unwrap_or(packet.place_ns);
        let packets = std::mem::take(&mut self.scan.packets);
        self.scan = Scan { packets, start_ns, ..Scan::default() };
        self.number = self.scan_of(packet.place_ns, packet.length_ns);
        self.open = true;
    }

    /// Packets that should have been before `place_ns`; a gap of more than half a packet is a loss.
    fn missing_before(&self, place_ns: i64, length_ns: i64) -> u32 {
        match self.expected_ns {
            Some(expected) if length_ns > 0 => {
                let missing = (place_ns.saturating_sub(expected) + length_ns / 2) / length_ns;
                u32::try_from(missing).unwrap_or(0)
            }
            _ => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// Scans of packets of a length, from a list of packet numbers: packets, lost, start and end.
    fn scans(length_ns: i64, numbers: impl Iterator<Item = i64>) -> Vec<(usize, u32, i64, i64)> {
        let mut assembly = Assembly::new(100 * MS, 40_000, 1000);
        let mut done = Vec::new();
        let mut finish = |assembly: &mut Assembly| {
            let scan = assembly.take();
            done.push((scan.packets.len(), scan.lost, scan.start_ns, scan.end_ns));
            assembly.recycle(scan);
        };
        for n in numbers {
            let packet = Arrived { slot: 0, place_ns: n * length_ns, length_ns, points: 100, arrival_ns: n };
            if assembly.is_too_early(&packet) {
                continue;
            }
            if assembly.is_complete_before(&packet) {
                finish(&mut assembly);
            }
            if assembly.add(&packet) {
                finish(&mut assembly);
            }
        }
        done
    }

    #[test]
    fn a_mid_40_gives_scans_of_exactly_a_hundred_packets_from_whole_tenths_of_a_second_on() {
        let done = scans(MS, 7..1007);
        assert_eq!(done.len(), 9);
        for (k, scan) in done.iter().enumerate() {
            let start = 100 * (k as i64 + 1) * MS;
            assert_eq!(*scan, (100, 0, start, start + 100 * MS));
        }
    }

    #[test]
    fn packets_that_come_after_their_scan_was_given_up_do_not_make_it_a_second_time() {
        let mut assembly = Assembly::new(100 * MS, 40_000, 1000);
        let packet =
            |n: i64| Arrived { slot: 0, place_ns: n * MS, length_ns: MS, points: 100, arrival_ns: n };
        assert!((100..160).all(|n| !assembly.is_too_late(&packet(n)) && !assembly.add(&packet(n))));
        assembly.give_up(200 * MS);
        let scan = assembly.take();
        assert_eq!((scan.packets.len(), scan.lost, scan.end_ns), (60, 40, 200 * MS));
        assembly.recycle(scan);
        assert!((160..200).all(|n| assembly.is_too_late(&packet(n))));
        assert!((200..299).all(|n| !assembly.is_too_late(&packet(n)) && !assembly.add(&packet(n))));
        assert!(assembly.add(&packet(299)));
        assert_eq!((assembly.take().start_ns, assembly.lost), (200 * MS, 40));
    }

    #[test]
    fn packets_that_do_not_divide_the_period_give_scans_without_gaps_of_its_length_on_average() {
        let done = scans(479_900, 0..2085);
        for pair in done.windows(2) {
            assert_eq!(pair[0].3, pair[1].2);
        }
        assert_eq!(done.len(), 10);
        assert!(done.iter().all(|(packets, lost, ..)| (208..=209).contains(packets) && *lost == 0));
    }

    #[test]
    fn lost_packets_are_counted_in_the_scan_that_they_belong_to_also_at_its_borders() {
        let missing = [50, 99, 100, 250, 299, 300, 301];
        let done = scans(MS, (0..500).filter(|n| !missing.contains(n)));
        let counts: Vec<_> = done.iter().map(|(packets, lost, ..)| (*packets, *lost)).collect();
        // What is missing at the end of a scan shows with the next packet, and is counted there.
        assert_eq!(counts, [(98, 1), (99, 2), (98, 1), (98, 3), (100, 0)]);
        assert_eq!(done.iter().map(|scan| scan.1).sum::<u32>(), 7);
        for pair in done.windows(2) {
            assert_eq!(pair[0].3, pair[1].2);
        }
    }

    #[test]
    fn a_silence_of_seconds_begins_a_new_scan_where_the_data_goes_on() {
        let done = scans(MS, (0..250).chain(3250..3450));
        assert_eq!(done[2].0, 50);
        assert_eq!(done[3], (50, 0, 3250 * MS, 3300 * MS));
        assert_eq!(done[4], (100, 0, 3300 * MS, 3400 * MS));
    }

    #[test]
    fn a_scan_ends_early_rather_than_outgrow_its_memory() {
        let mut assembly = Assembly::new(100 * MS, 250, 1000);
        let packet =
            |n: i64| Arrived { slot: 0, place_ns: n * MS, length_ns: MS, points: 100, arrival_ns: n };
        assert!(!assembly.add(&packet(0)) && !assembly.add(&packet(1)));
        assert!(assembly.is_complete_before(&packet(2)));
    }

    #[test]
    fn packets_that_never_come_are_lost_when_they_are_given_up() {
        let mut assembly = Assembly::new(100 * MS, 40_000, 1000);
        for n in 0..60 {
            assembly.add(&Arrived { slot: 0, place_ns: n * MS, length_ns: MS, points: 100, arrival_ns: n });
        }
        assembly.give_up(100 * MS);
        let scan = assembly.take();
        assert_eq!((scan.lost, scan.end_ns, assembly.lost), (40, 100 * MS, 40));
    }
}
