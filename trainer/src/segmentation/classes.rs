//! The classes that the network tells apart: SemanticKITTI's, merged to those that few scans hold enough of.

/// Number of classes.
pub const CLASSES: usize = 10;

/// Their names.
pub const NAMES: [&str; CLASSES] =
    ["vehicle", "person or rider", "road", "sidewalk", "building", "fence", "vegetation", "trunk", "terrain", "pole"];

/// The class of one of the learning map's (see [`lidar::label`]); `None` where it is unlabelled.
pub fn merged(class: u8) -> Option<usize> {
    match class {
        1 | 4 | 5 => Some(0),
        // Bicycles and motorcycles are mostly ridden, and as thin as their riders.
        2 | 3 | 6 | 7 | 8 => Some(1),
        // A parking bay is paved like the road beside it.
        9 | 10 => Some(2),
        11 | 12 => Some(3),
        13 => Some(4),
        14 => Some(5),
        15 => Some(6),
        16 => Some(7),
        17 => Some(8),
        18 | 19 => Some(9),
        _ => None,
    }
}

/// The learning map's class that stands for each of these, the commonest of those that are merged in it.
pub const COMMONEST: [u8; CLASSES] = [1, 6, 9, 11, 13, 14, 15, 16, 17, 18];

#[cfg(test)]
mod tests {
    use lidar::label::CLASS_NAMES;

    use super::*;

    #[test]
    fn what_stands_for_a_class_is_in_it() {
        assert!(COMMONEST.iter().enumerate().all(|(class, commonest)| merged(*commonest) == Some(class)));
    }

    #[test]
    fn every_labelled_class_is_in_one_that_its_name_fits() {
        assert_eq!(merged(0), None);
        assert!((1..CLASS_NAMES.len() as u8).all(|class| merged(class).is_some()));
        for name in ["road", "sidewalk", "building", "fence", "vegetation", "trunk", "terrain", "pole"] {
            let class = CLASS_NAMES.iter().position(|n| *n == name).and_then(|class| merged(class as u8));
            assert_eq!(class.map(|class| NAMES[class]), Some(name));
        }
    }
}
