//! Buildings, the people in them, and the nearest thing that a ray meets.

mod atrium;
mod build;
mod bvh;
mod cavern;
mod corridor;
mod fitter;
mod floor_plan;
mod furniture;
mod hall;
mod material;
mod measured;
mod neighbours;
mod office;
mod open_hall;
mod outline;
mod people;
mod plant;
mod ramp;
mod ray;
mod relief;
mod room;
mod shaft;
mod shape;
mod solid;
mod stairwell;
mod tour;
mod tunnel;

pub(crate) use material::Material;
pub(crate) use ray::Ray;
pub(crate) use solid::Cylinder;

use evac_geometry::nalgebra::Vector3;
use evac_stage::StageError;

use crate::config::Config;
use crate::trajectory::Route;
use crate::world_kind::WorldKind;
use build::Site;
use bvh::Bvh;
use cavern::Cavern;
use floor_plan::Style;
use people::Person;
use solid::Solid;
use tour::Tour;

/// A building with its people.
#[derive(Debug, Clone)]
pub(crate) struct World {
    bvh: Bvh,
    cavern: Option<Cavern>,
    people: Vec<Person>,
}

impl World {
    /// Builds the configured world and the route through it.
    ///
    /// # Errors
    /// [`StageError::File`] where a cloud cannot be read.
    pub(crate) fn build(config: &Config) -> Result<(Self, Route), StageError> {
        let start = |place: [f64; 3], heading_deg: f64| {
            Route::start(place, heading_deg, config.speed_m_s, config.turn_rate_dps)
        };
        let (site, route) = match config.world {
            WorldKind::Corridor => (corridor::build(), corridor::route(start)),
            WorldKind::Hall => (hall::build(), hall::route(start)),
            WorldKind::Stairwell => (stairwell::build(), stairwell::route(start)),
            WorldKind::FloorPlan => toured(floor_plan::build(config.building, Style::Basement), start),
            WorldKind::Rough => toured(floor_plan::build(config.building, Style::Cellar), start),
            WorldKind::Tunnel => toured(tunnel::build(config.building), start),
            WorldKind::Plant => toured(plant::build(config.building), start),
            WorldKind::Office => toured(office::build(config.building), start),
            WorldKind::Atrium => toured(atrium::build(config.building), start),
            WorldKind::OpenHall => toured(open_hall::build(config.building), start),
            WorldKind::Ramp => toured(ramp::build(config.building), start),
            WorldKind::Shaft => toured(shaft::build(config.building), start),
            WorldKind::SemiReal => toured(measured::build(&config.clouds, &config.way_points_m)?, start),
        };
        Ok((Self::new(site, config.roughness(), config.building), route.laps(config.laps)))
    }

    fn new(site: Site, roughness_m: f64, seed: u64) -> Self {
        let rough = |solid: Solid| solid.roughened(roughness_m, seed);
        Self {
            bvh: Bvh::new(site.solids.into_iter().map(rough).collect()),
            cavern: Cavern::new(site.hollows, roughness_m, seed),
            people: site.people,
        }
    }

    /// Writes the people's shapes at `t` seconds to `shapes`.
    pub(crate) fn people_at(&self, t: f64, shapes: &mut Vec<Cylinder>) {
        shapes.clear();
        shapes.extend(self.people.iter().flat_map(|person| person.shape(t)));
    }

    /// Whether a place lies within a body, people and rock left out.
    pub(crate) fn is_solid(&self, place: &Vector3<f64>) -> bool {
        self.bvh.solids().iter().any(|solid| solid.distance(place) == 0.0)
    }

    /// Distance to and material of the nearest thing within `limit` metres.
    pub(crate) fn cast(&self, ray: &Ray, people: &[Cylinder], limit: f64) -> Option<(f64, Material)> {
        let person = people.iter().filter_map(|part| part.hit(ray)).fold(limit, f64::min);
        let mut nearest = (person < limit).then_some((person, Material::Cloth));
        if let Some((range, solid)) = self.bvh.cast(ray, person) {
            nearest = Some((range, solid.material));
        }
        let so_far = nearest.map_or(limit, |(range, _)| range);
        let rock = self.cavern.as_ref().and_then(|cavern| cavern.cast(ray, so_far));
        rock.map(|range| (range, Material::Stone)).or(nearest)
    }
}

fn toured((site, tour): (Site, Tour), start: impl Fn([f64; 3], f64) -> Route) -> (Site, Route) {
    (site, tour.route(start))
}

#[cfg(test)]
mod catalogue_tests;
#[cfg(test)]
mod tests;
