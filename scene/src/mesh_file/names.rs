//! What a name says about a surface: its label, and how bright such surfaces are.

use crate::material::Material;

/// Words and the `SemanticKITTI` id that they mean; the first one that a name contains counts, so the narrower ones come first.
const WORDS: [(&[&str], u32); 22] = [
    (&["trafficlight", "trafficlights", "lamp", "lamppost", "streetlight", "pole", "post", "mast", "bollard"], 80),
    (&["sign", "signs", "trafficsign", "signboard"], 81),
    (&["motorcyclist"], 32),
    (&["bicyclist", "cyclist", "rider"], 31),
    (&["motorcycle", "motorbike", "scooter"], 15),
    (&["bicycle", "bike", "cycle"], 11),
    (&["person", "pedestrian", "people", "human", "walker"], 30),
    (&["truck", "lorry"], 18),
    (&["bus", "coach"], 13),
    (&["trailer", "caravan", "tram", "train", "vehicle"], 20),
    (&["car", "cars", "taxi", "van", "suv", "sedan", "hatchback"], 10),
    (&["trunk", "bark", "stem"], 71),
    (&["tree", "leaf", "leaves", "bush", "hedge", "vegetation", "plant", "foliage", "shrub", "heesters"], 70),
    (&["grass", "lawn", "terrain", "soil", "dirt", "earth", "field", "gras", "onverhard"], 72),
    (&["fence", "railing", "guardrail", "gate", "muur", "kademuur"], 51),
    (
        &["sidewalk", "pavement", "footpath", "footway", "kerb", "curb", "voetpad", "voetgangersgebied", "verharding"],
        48,
    ),
    (&["parking", "driveway", "parkeervlak"], 44),
    (&["marking", "markings", "paint", "crosswalk", "zebra", "lane", "lanes"], 60),
    (&["road", "street", "asphalt", "tarmac", "highway", "rijbaan", "fietspad"], 40),
    (&["water", "gravel", "rail", "track"], 49),
    (&["bridge", "tunnel"], 52),
    (&["building", "house", "wall", "roof", "facade", "window", "door", "brick"], 50),
];

/// The label that a name's words mean: `TrafficSign_03`, `house wall`, `Road.001`.
pub(super) fn label_of(name: &str) -> Option<u32> {
    let words = words(name);
    // Two neighbours may be one word: "traffic light".
    let pairs: Vec<String> = words.windows(2).map(<[String]>::concat).collect();
    let says = |known: &str| words.iter().chain(&pairs).any(|word| word == known);
    WORDS.iter().find(|(known, _)| known.iter().any(|k| says(k))).map(|(_, label)| *label)
}

/// A material of that label with a reflectance that is typical for it in the near infrared.
pub(super) fn typical(label: u32) -> Material {
    let reflectance = match label {
        40 | 44 => 0.18,
        60 => 0.6,
        48 | 52 => 0.3,
        49 => 0.15,
        50 | 51 => 0.4,
        70 | 72 => 0.45,
        81 => return Material::retro(label, 0.95),
        _ => 0.35,
    };
    Material::diffuse(label, reflectance)
}

/// A material of that label whose base colour (linear RGB) gives its reflectance: the luminance of ITU-R BT.709.
pub(super) fn coloured(label: u32, [r, g, b]: [f32; 3]) -> Material {
    let luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b;
    let reflectance = if luminance.is_finite() { luminance.clamp(0.0, 1.0) } else { 0.0 };
    // Sheeting sends back what it gets, whatever its colour.
    if label == 81 { typical(label) } else { Material::diffuse(label, reflectance) }
}

/// The lower-case words of a name: cut at everything that is no letter, and before a capital that follows a small letter.
fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut small = false;
    for letter in name.chars() {
        if !letter.is_alphabetic() || small && letter.is_uppercase() {
            words.push(String::new());
        }
        if letter.is_alphabetic()
            && let Some(word) = words.last_mut()
        {
            word.extend(letter.to_lowercase());
        }
        small = letter.is_lowercase();
    }
    words.retain(|word| !word.is_empty());
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_as_people_write_them_are_understood() {
        for (name, label) in [
            ("Road.001", Some(40)),
            ("TrafficSign_03", Some(81)),
            ("traffic light pole", Some(80)),
            ("SM_Tree_Leaves", Some(70)),
            ("car_body", Some(10)),
            ("carpet", None),
            ("Cube", None),
            ("lane-marking", Some(60)),
            ("BUILDING", Some(50)),
        ] {
            assert_eq!(label_of(name), label, "{name}");
        }
    }
}
