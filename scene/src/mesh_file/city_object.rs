//! What `CityJSON`'s types, attributes and surface semantics mean to a lidar.

use serde_json::{Map, Value};

use super::names;
use crate::material::Material;

/// The material of an object of that type; `name` gives each its own shade.
pub(super) fn material(kind: &str, attributes: &Map<String, Value>, name: &str) -> Material {
    let label = label_of_attributes(kind, attributes).unwrap_or_else(|| label_of_type(kind));
    shaded(names::typical(label), name)
}

/// The material of one surface of an object, where the file says what it is; otherwise the object's own.
pub(super) fn surface(semantics: Option<&str>, object: Material) -> Material {
    match semantics {
        // Glass sends little back.
        Some("Window") => Material { reflectance: 0.06, ..object },
        Some("Door") => Material { reflectance: 0.8 * object.reflectance, ..object },
        Some("RoofSurface") => Material { reflectance: 0.65 * object.reflectance, ..object },
        Some("TrafficArea") => names::typical(40),
        Some("AuxiliaryTrafficArea") => names::typical(48),
        Some("TransportationMarking") => names::typical(60),
        _ => object,
    }
}

/// `CityJSON` 1.1 and 2.0, section 2: types of city objects.
fn label_of_type(kind: &str) -> u32 {
    match kind {
        _ if kind.starts_with("Building") => 50,
        "Road" | "TransportSquare" => 40,
        "LandUse" | "TINRelief" => 72,
        "PlantCover" | "SolitaryVegetationObject" => 70,
        "WaterBody" | "Waterway" | "Railway" => 49,
        "CityFurniture" => 99,
        _ if kind.starts_with("Bridge") || kind.starts_with("Tunnel") => 52,
        _ => 0,
    }
}

/// Kinds of road, land and furniture are told by attributes, which each country names as it likes.
fn label_of_attributes(kind: &str, attributes: &Map<String, Value>) -> Option<u32> {
    const TELLING: [&str; 5] = ["class", "function", "usage", "type", "fysiekvoorkomen"];
    if !["Road", "LandUse", "CityFurniture", "GenericCityObject", "+GenericCityObject"].contains(&kind) {
        return None;
    }
    let mut telling = attributes.iter().filter(|(key, _)| TELLING.iter().any(|end| key.ends_with(end)));
    telling.find_map(|(_, value)| names::label_of(value.as_str()?))
}

/// The same material up to a quarter darker or brighter, always alike for the same name (FNV-1a).
fn shaded(material: Material, name: &str) -> Material {
    let hash = name.bytes().fold(0x811c_9dc5u32, |h, b| (h ^ u32::from(b)).wrapping_mul(0x0100_0193));
    let share = (hash >> 8) as f32 / (1u32 << 24) as f32;
    Material { reflectance: (material.reflectance * (0.75 + 0.5 * share)).min(1.0), ..material }
}
