//! Which surfaces of the ground can be walked to from the path: by steps from block to block.
//!
//! What can be reached does not depend on the order in which the ground was seen, but asking anew after each update would cost
//! as much as the whole map. So every surface that is reached remembers from which one. Where ground changes, only what hung on
//! it is asked again.

use rustc_hash::{FxHashMap, FxHashSet};

use crate::raster::{Place, around};

/// How far a step reaches, blocks: a block without ground between two others does not part them.
const REACH: i32 = 2;

/// A surface: its block, and its number in it.
type Name = (Place, usize);

/// What a surface hangs on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Support {
    /// It is not reached.
    None,
    /// The path passes above it.
    Path,
    /// It is one step from another one.
    Surface(Name),
}

#[derive(Debug, Clone, Copy)]
struct Node {
    /// Height, metres.
    level: f64,
    support: Support,
}

/// All surfaces, and which of them are reached.
#[derive(Debug, Default)]
pub(crate) struct Reach {
    nodes: FxHashMap<Place, Vec<Node>>,
    max_step: f64,
}

impl Reach {
    /// `max_step`: largest step, metres.
    pub(crate) fn new(max_step: f64) -> Self {
        Self { nodes: FxHashMap::default(), max_step }
    }

    /// Heights of the surfaces of a block, reached or not, metres.
    pub(crate) fn surfaces(&self, block: Place) -> impl Iterator<Item = f64> {
        self.of(block).iter().map(|node| node.level)
    }

    /// Heights of the surfaces of a block that are reached, metres.
    pub(crate) fn reached(&self, block: Place) -> impl Iterator<Item = f64> {
        self.of(block).iter().filter(|node| node.support != Support::None).map(|node| node.level)
    }

    /// Replaces the surfaces of a block; call [`Self::settle`] with it afterwards.
    pub(crate) fn set(&mut self, block: Place, levels: &[f64]) {
        let nodes = self.nodes.entry(block).or_default();
        // What hung on a surface that is still there may go on hanging on it: `settle` looks whether it can.
        nodes.resize(levels.len(), Node { level: 0.0, support: Support::None });
        for (node, level) in nodes.iter_mut().zip(levels) {
            node.level = *level;
        }
        if levels.is_empty() {
            self.nodes.remove(&block);
        }
    }

    /// Finds what is reached after the surfaces of, or the path above, the `changed` blocks have changed. Gives every block in
    /// which a surface may be reached now that was not, or the other way round. `path`: heights of the floor below the path in a
    /// block, metres.
    pub(crate) fn settle<I: Iterator<Item = f64>>(
        &mut self,
        changed: &FxHashSet<Place>,
        path: impl Fn(Place) -> I,
    ) -> FxHashSet<Place> {
        let max_step = self.max_step;
        let under_path = |block: Place, level: f64| {
            around(block, REACH).any(|near| path(near).any(|floor| (floor - level).abs() <= max_step))
        };
        let near: FxHashSet<Place> = changed.iter().flat_map(|block| around(*block, REACH)).collect();
        let mut touched = changed.clone();

        // Who has lost what it hung on, and all that hung on it in turn.
        let mut doubtful: Vec<Name> = near.iter().flat_map(|block| self.names(*block)).collect();
        let mut open: FxHashSet<Name> = FxHashSet::default();
        while let Some(name) = doubtful.pop() {
            let holds = match self.support(name) {
                Support::None => {
                    open.insert(name);
                    continue;
                }
                Support::Path => self.level(name).is_some_and(|level| under_path(name.0, level)),
                Support::Surface(other) => self.support(other) != Support::None && self.is_step(name, other),
            };
            if !holds {
                open.insert(name);
                touched.insert(name.0);
                doubtful.extend(self.hanging_on(name));
                self.hang(name, Support::None);
            }
        }

        // Who can be reached now, and all that can be reached from it in turn.
        let mut open: Vec<Name> = open.into_iter().collect();
        while let Some(name) = open.pop() {
            let Some(level) = self.level(name).filter(|_| self.support(name) == Support::None) else {
                continue;
            };
            let support = if under_path(name.0, level) {
                Support::Path
            } else {
                let others = around(name.0, REACH).flat_map(|block| self.names(block));
                let mut reached = others.filter(|other| self.support(*other) != Support::None);
                match reached.find(|other| self.is_step(name, *other)) {
                    Some(other) => Support::Surface(other),
                    None => continue,
                }
            };
            self.hang(name, support);
            touched.insert(name.0);
            let others = around(name.0, REACH).flat_map(|block| self.names(block));
            open.extend(
                others.filter(|other| self.support(*other) == Support::None && self.is_step(name, *other)),
            );
        }
        touched
    }

    fn of(&self, block: Place) -> &[Node] {
        self.nodes.get(&block).map_or(&[], Vec::as_slice)
    }

    fn names(&self, block: Place) -> impl Iterator<Item = Name> + use<> {
        (0..self.of(block).len()).map(move |number| (block, number))
    }

    fn level(&self, (block, number): Name) -> Option<f64> {
        self.of(block).get(number).map(|node| node.level)
    }

    fn support(&self, (block, number): Name) -> Support {
        self.of(block).get(number).map_or(Support::None, |node| node.support)
    }

    fn hang(&mut self, (block, number): Name, support: Support) {
        if let Some(node) = self.nodes.get_mut(&block).and_then(|nodes| nodes.get_mut(number)) {
            node.support = support;
        }
    }

    fn is_step(&self, a: Name, b: Name) -> bool {
        let (Some(from), Some(to)) = (self.level(a), self.level(b)) else { return false };
        a != b && (from - to).abs() <= self.max_step
    }

    fn hanging_on(&self, name: Name) -> Vec<Name> {
        let others = around(name.0, REACH).flat_map(|block| self.names(block));
        others.filter(|other| self.support(*other) == Support::Surface(name)).collect()
    }
}
