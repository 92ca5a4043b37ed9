//! Words for building: blocks, walls with doors, rooms, stairs.

use super::material::Material;
use super::people::Person;
use super::shape::Shape;
use super::solid::Solid;

/// Thickness of walls, metres.
pub(super) const WALL: f64 = 0.3;
const DOOR_LEAF: f64 = 0.05;

/// Direction that a wall runs along.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Along {
    X,
    Y,
}

/// A hole in a wall, by the coordinate of its middle along the wall, its width and height.
#[derive(Debug, Clone, Copy)]
pub(super) struct Opening {
    pub(super) at: f64,
    pub(super) width: f64,
    pub(super) height: f64,
    pub(super) filling: Filling,
}

/// What is in an opening.
#[derive(Debug, Clone, Copy)]
pub(super) enum Filling {
    Nothing,
    /// A closed leaf in the middle of the wall: a recess on both sides.
    ClosedDoor,
    /// A leaf that stands open by these degrees, hinged at the opening's lower end; positive opens to higher
    /// coordinates across the wall.
    OpenDoor(f64),
    Window,
}

/// A door 0.95 m wide and 2.05 m high.
pub(super) fn door(at: f64) -> Opening {
    Opening { at, width: 0.95, height: 2.05, filling: Filling::ClosedDoor }
}

/// A door that stands open, see [`Filling::OpenDoor`].
pub(super) fn open_door(at: f64, degrees: f64) -> Opening {
    Opening { filling: Filling::OpenDoor(degrees), ..door(at) }
}

/// A passage without a door.
pub(super) fn passage(at: f64, width: f64, height: f64) -> Opening {
    Opening { at, width, height, filling: Filling::Nothing }
}

/// A world under construction.
#[derive(Debug, Default)]
pub(super) struct Site {
    pub(super) solids: Vec<Solid>,
    pub(super) people: Vec<Person>,
    /// What is cut out of the rock, where the world is a cavern.
    pub(super) hollows: Vec<Shape>,
}

impl Site {
    pub(super) fn block(&mut self, min: [f64; 3], max: [f64; 3], material: Material) {
        self.solids.push(Solid::between(min, max, material));
    }

    pub(super) fn turned(&mut self, centre: [f64; 3], size: [f64; 3], degrees: f64, material: Material) {
        self.solids.push(Solid::turned(centre, size, degrees, material));
    }

    /// A wall over `span` along its direction and `across` its thickness, from `floor` to `top`.
    pub(super) fn wall(
        &mut self,
        along: Along,
        span: [f64; 2],
        across: [f64; 2],
        [floor, top]: [f64; 2],
        openings: &[Opening],
    ) {
        let mut openings = openings.to_vec();
        openings.sort_by(|a, b| a.at.total_cmp(&b.at));
        let mut from = span[0];
        for opening in &openings {
            let (left, right) = (opening.at - opening.width / 2.0, opening.at + opening.width / 2.0);
            self.piece(along, [from, left], across, [floor, top], Material::Plaster);
            self.piece(along, [left, right], across, [floor + opening.height, top], Material::Plaster);
            self.fill(along, opening, across, floor);
            from = right;
        }
        self.piece(along, [from, span[1]], across, [floor, top], Material::Plaster);
    }

    fn piece(
        &mut self,
        along: Along,
        span: [f64; 2],
        across: [f64; 2],
        height: [f64; 2],
        material: Material,
    ) {
        let [min, max] = [0, 1].map(|end| match along {
            Along::X => [span[end], across[end], height[end]],
            Along::Y => [across[end], span[end], height[end]],
        });
        if min.iter().zip(&max).all(|(a, b)| a < b) {
            self.block(min, max, material);
        }
    }

    fn fill(&mut self, along: Along, opening: &Opening, across: [f64; 2], floor: f64) {
        let (left, right) = (opening.at - opening.width / 2.0, opening.at + opening.width / 2.0);
        let middle = (across[0] + across[1]) / 2.0;
        let leaf = [middle - DOOR_LEAF / 2.0, middle + DOOR_LEAF / 2.0];
        let height = [floor, floor + opening.height];
        match opening.filling {
            Filling::Nothing => {}
            Filling::ClosedDoor => self.piece(along, [left, right], leaf, height, Material::Wood),
            Filling::Window => {
                // A parapet of 0.9 m below the pane.
                self.piece(along, [left, right], across, [floor, floor + 0.9], Material::Plaster);
                self.piece(along, [left, right], leaf, [floor + 0.9, height[1]], Material::Glass);
            }
            Filling::OpenDoor(degrees) => {
                let hinge = if degrees > 0.0 { across[1] } else { across[0] };
                let (sin, cos) = degrees.to_radians().sin_cos();
                let reach = opening.width / 2.0;
                let (a, c) = (left + reach * cos, hinge + reach * sin);
                let z = floor + opening.height / 2.0;
                let size = [opening.width, DOOR_LEAF, opening.height];
                match along {
                    Along::X => self.turned([a, c, z], size, degrees, Material::Wood),
                    Along::Y => self.turned([c, a, z], size, 90.0 - degrees, Material::Wood),
                }
            }
        }
    }

    /// A flight of steps along x: `steps` risers from `foot` (x, lower y, height) up; `run` is signed.
    /// `thickness` is how far each step reaches down.
    pub(super) fn flight(
        &mut self,
        foot: [f64; 3],
        width: f64,
        steps: u32,
        [run, rise]: [f64; 2],
        thickness: f64,
    ) {
        for step in 0..steps {
            let x = foot[0] + run * f64::from(step);
            let top = foot[2] + rise * f64::from(step + 1);
            let bottom = (top - thickness).max(foot[2].min(0.0));
            let (x0, x1) = if run > 0.0 { (x, x + run) } else { (x + run, x) };
            self.block([x0, foot[1], bottom], [x1, foot[1] + width, top], Material::Concrete);
        }
    }
}
