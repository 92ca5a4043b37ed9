//! The points of a scan, out of its packets one after the other.

use evac_frames::Point;

use crate::Protocol;
use crate::assembly::Held;
use crate::packet::Packet;
use crate::store::Store;

/// Decodes the points of a scan's packets in order.
pub(crate) struct Points<'a> {
    protocol: Protocol,
    store: &'a Store,
    held: std::slice::Iter<'a, Held>,
    shot_ns: f64,
    current: Option<Current<'a>>,
}

struct Current<'a> {
    packet: Packet<'a>,
    next: usize,
    until: usize,
    /// Echoes left of the shot at hand.
    echoes_left: usize,
    echoes: usize,
    offset_ns: f64,
    shot_ns: f64,
}

impl<'a> Points<'a> {
    /// `shot_ns` is the time between two shots where packets do not say it.
    pub(crate) fn new(protocol: Protocol, store: &'a Store, held: &'a [Held], shot_ns: f64) -> Self {
        Self { protocol, store, held: held.iter(), shot_ns, current: None }
    }

    /// The next point; the origin after the last.
    #[inline]
    pub(crate) fn next(&mut self) -> Point {
        loop {
            if let Some(current) = &mut self.current
                && current.next < current.until
            {
                let point = current.packet.point(current.next).map_or_else(Point::default, |point| {
                    let [x, y, z] = point.position;
                    Point::new(x, y, z, current.offset_ns as i64, point.reflectivity)
                });
                current.next += 1;
                current.echoes_left -= 1;
                if current.echoes_left == 0 {
                    current.echoes_left = current.echoes;
                    current.offset_ns += current.shot_ns;
                }
                return point;
            }
            let Some(held) = self.held.next() else { return Point::default() };
            self.current = Packet::parse_again(self.protocol, self.store.packet(held.slot)).map(|packet| {
                let echoes = packet.echoes().max(1);
                Current {
                    packet,
                    next: 0,
                    until: packet.shots() * packet.echoes(),
                    echoes_left: echoes,
                    echoes,
                    // Half a nanosecond, so that whole ones are not rounded down.
                    offset_ns: held.offset_ns as f64 + 0.5,
                    shot_ns: packet.shot_ns().unwrap_or(self.shot_ns),
                }
            });
        }
    }
}
