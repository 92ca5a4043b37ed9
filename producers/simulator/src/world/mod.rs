//! Buildings, the people in them, and the nearest thing that a ray meets.

mod build;
mod bvh;
mod corridor;
mod floor_plan;
mod furniture;
mod hall;
mod material;
mod outline;
mod people;
mod ray;
mod relief;
mod shape;
mod solid;
mod stairwell;
mod tour;

pub(crate) use material::Material;
pub(crate) use ray::Ray;
pub(crate) use solid::Cylinder;

use crate::config::{Config, WorldKind};
use crate::trajectory::Route;
use build::Site;
use bvh::Bvh;
use floor_plan::Style;
use people::Person;
use solid::Solid;
use tour::Tour;

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
            WorldKind::FloorPlan => toured(floor_plan::build(config.building, Style::Basement), start),
            WorldKind::Rough => toured(floor_plan::build(config.building, Style::Cellar), start),
        };
        (Self::new(site, config.roughness(), config.building), route.laps(config.laps))
    }

    fn new(site: Site, roughness_m: f64, seed: u64) -> Self {
        let rough = |solid: Solid| solid.roughened(roughness_m, seed);
        Self { bvh: Bvh::new(site.solids.into_iter().map(rough).collect()), people: site.people }
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

fn toured((site, tour): (Site, Tour), start: impl Fn([f64; 3], f64) -> Route) -> (Site, Route) {
    (site, tour.route(start))
}

#[cfg(test)]
mod tests;
