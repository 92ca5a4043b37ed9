//! The buildings that can be walked through.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

/// The building that is walked through.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum WorldKind {
    /// A basement corridor in a rectangle of 17 x 11 m, walked once round (four turns of 90 degrees on the spot).
    #[default]
    Corridor,
    /// A station hall of 34 x 20 m with pillars, stairs, ticket machines and walking people.
    Hall,
    /// Two storeys of 3.4 m joined by a dog-leg stair, which the walker climbs.
    Stairwell,
    /// Corridors drawn from `building`: a rectangle, L, U, figure of eight, T or Z, 1.6 to 3 m wide, with doors, rooms,
    /// niches, cabinets and ducts; boxes only, smooth unless `roughness_m` is set.
    FloorPlan,
    /// A cellar of quarry stone and broken plaster, drawn from `building`, with barrels, props, pipes and rubble.
    Rough,
    /// A tunnel of round bores through rock, drawn from `building`, with bends of 40 to 95 degrees, domed chambers, niches,
    /// pipes and rails.
    Tunnel,
    /// A plant room with tanks, machines and pipes in all directions, drawn from `building`.
    Plant,
    /// An office floor with desks, thin-legged chairs, full shelves, plants and somebody walking, drawn from `building`.
    Office,
    /// An atrium with facades of glass that throws no shot back, rough walls, round pillars, plants and people, drawn from
    /// `building`.
    Atrium,
    /// A hall of 50 x 30 x 8 m with few things and four people in it, drawn from `building`.
    OpenHall,
    /// A bent corridor with two ramps up and one down (5 to 15 %), drawn from `building`.
    Ramp,
    /// A landing around a stairwell's eye of 18 m, with a lift shaft behind an open door, drawn from `building`.
    Shaft,
    /// Discs in place of the points of `clouds`, along `way_points_m`.
    #[value(skip)]
    SemiReal,
}

impl WorldKind {
    /// Roughness of the world where the configuration does not say, metres.
    pub(crate) fn roughness_m(self) -> f64 {
        match self {
            Self::Rough | Self::Tunnel => 0.02,
            Self::Atrium | Self::OpenHall => 0.01,
            Self::Plant | Self::Office => 0.006,
            _ => 0.0,
        }
    }
}
