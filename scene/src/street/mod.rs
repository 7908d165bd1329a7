//! A street made up from a seed: road, paint, pavements, houses, vehicles, people, trees, poles and signs.

mod bicycle;
mod car;
mod config;
mod fence;
mod ground;
mod house;
mod lorry;
mod marking;
mod person;
mod plan;
mod planting;
mod pole;
mod populate;
mod road;
mod surface;
mod traffic;
mod tree;

pub use config::{Span, StreetConfig};

use glam::Affine3A;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::mesh::Mesh;
use crate::scene::Scene;
use plan::Plan;

/// A street: the same seed and configuration always give the same one.
///
/// It runs along x through the world's origin, which lies on the road's surface in the middle of a lane; a sensor at the default
/// [`Pose`](crate::Pose) looks along it. Nothing but the road is within 1.5 m of that sensor.
pub fn street(seed: u64, config: &StreetConfig) -> Scene {
    Scene::new(mesh(seed, config))
}

/// The street's triangles alone.
pub fn mesh(seed: u64, config: &StreetConfig) -> Mesh {
    let config = config.bounded();
    let plan = Plan::new(&config, &mut dice(seed, Part::Plan));
    let mut site = Site { mesh: Mesh::new(), instances: 0 };
    ground::build(&mut site, &plan, &mut dice(seed, Part::Ground));
    populate::houses(&mut site, &plan, &mut dice(seed, Part::Houses));
    planting::trees(&mut site, &plan, &mut dice(seed, Part::Trees));
    populate::furniture(&mut site, &plan, &mut dice(seed, Part::Furniture));
    traffic::vehicles(&mut site, &plan, &mut dice(seed, Part::Vehicles));
    traffic::people(&mut site, &plan, &mut dice(seed, Part::People));
    site.mesh
}

/// The generator of everything random here; `ChaCha` gives the same numbers on every machine.
type Dice = ChaCha8Rng;

/// What a stream of random numbers is for: a change in one part leaves the others as they were.
#[derive(Clone, Copy)]
enum Part {
    Plan,
    Ground,
    Houses,
    Trees,
    Furniture,
    Vehicles,
    People,
}

fn dice(seed: u64, part: Part) -> Dice {
    let mut dice = Dice::seed_from_u64(seed);
    dice.set_stream(part as u64);
    dice
}

/// What has been built so far.
struct Site {
    mesh: Mesh,
    instances: u32,
}

impl Site {
    /// Puts a finished thing in its place.
    fn put(&mut self, thing: &Mesh, world_from_thing: &Affine3A) {
        self.mesh.append(thing, world_from_thing);
    }

    /// A label with the next instance number in its upper half.
    fn instance(&mut self, label: u32) -> u32 {
        self.instances += 1;
        (self.instances & 0xffff) << 16 | label
    }
}
