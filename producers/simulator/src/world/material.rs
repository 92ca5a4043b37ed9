//! What surfaces are made of: how bright and how rough they are, and whether a shot comes back at all.

/// What a surface is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Material {
    Concrete,
    Plaster,
    Metal,
    Wood,
    /// A pane that throws few shots back.
    Glass,
    /// A pane that throws no shot back.
    ClearGlass,
    Sign,
    Cloth,
    /// Quarry stone and raw rock.
    Stone,
    Leaves,
    /// Whatever a measured point lies on.
    Measured,
}

impl Material {
    /// Reflectivity as the Mid-40 reports it: 0..150 is 0..100 % diffuse, more is retro-reflective.
    pub(crate) fn reflectivity(self) -> f64 {
        match self {
            Self::Concrete => 40.0,
            Self::Plaster => 95.0,
            Self::Metal | Self::Measured => 60.0,
            Self::Wood => 70.0,
            Self::Glass | Self::ClearGlass => 12.0,
            Self::Sign => 210.0,
            Self::Cloth => 30.0,
            Self::Stone => 50.0,
            Self::Leaves => 65.0,
        }
    }

    /// Share of shots that come back.
    pub(crate) fn returns(self) -> f64 {
        match self {
            Self::Glass => 0.15,
            Self::ClearGlass => 0.0,
            _ => 1.0,
        }
    }

    /// Share of the building's roughness that a surface of it has: floors are worn, metal and wood are as made.
    pub(super) fn roughness(self) -> f64 {
        match self {
            Self::Plaster | Self::Stone => 1.0,
            Self::Concrete => 0.4,
            _ => 0.0,
        }
    }
}
