//! Buildings made of boxes, the people in them, and the nearest thing that a ray meets.

mod build;
mod bvh;
mod corridor;
mod hall;
mod people;
mod solid;
mod stairwell;

pub(crate) use solid::{Cylinder, Material, Ray};

use crate::config::{Config, WorldKind};
use crate::trajectory::Route;
use build::Site;
use bvh::Bvh;
use people::Person;

/// A building with its people.
#[derive(Debug, Clone)]
pub(crate) struct World {
    bvh: Bvh,
    people: Vec<Person>,
}

impl World {
    /// Builds the configured world and the route through it.
    pub(crate) fn build(config: &Config) -> (Self, Route) {
        let start = |place: [f64; 3], heading_deg: f64| {
            Route::start(place, heading_deg, config.speed_m_s, config.turn_rate_dps)
        };
        let (site, route) = match config.world {
            WorldKind::Corridor => (corridor::build(), corridor::route(start)),
            WorldKind::Hall => (hall::build(), hall::route(start)),
            WorldKind::Stairwell => (stairwell::build(), stairwell::route(start)),
        };
        (Self::new(site), route)
    }

    fn new(site: Site) -> Self {
        Self { bvh: Bvh::new(site.solids), people: site.people }
    }

    /// Writes the people's shapes at `t` seconds to `shapes`.
    pub(crate) fn people_at(&self, t: f64, shapes: &mut Vec<Cylinder>) {
        shapes.clear();
        shapes.extend(self.people.iter().flat_map(|person| person.shape(t)));
    }

    /// Distance to and material of the nearest thing within `limit` metres.
    pub(crate) fn cast(&self, ray: &Ray, people: &[Cylinder], limit: f64) -> Option<(f64, Material)> {
        let person = people.iter().filter_map(|part| part.hit(ray)).fold(limit, f64::min);
        match self.bvh.cast(ray, person) {
            Some((range, solid)) => Some((range, solid.material)),
            None => (person < limit).then_some((person, Material::Cloth)),
        }
    }
}

#[cfg(test)]
mod tests;
