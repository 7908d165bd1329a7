//! Semantic classes: SemanticKITTI's label ids, its 20-class learning map, and CARLA's tags.

/// Number of classes of the learning map, the unlabelled one (0) included.
pub const CLASSES: usize = 20;

/// Names of the learning map's classes (SemanticKITTI, `semantic-kitti.yaml`, `learning_map_inv`).
pub const CLASS_NAMES: [&str; CLASSES] = [
    "unlabelled",
    "car",
    "bicycle",
    "motorcycle",
    "truck",
    "other-vehicle",
    "person",
    "bicyclist",
    "motorcyclist",
    "road",
    "parking",
    "sidewalk",
    "other-ground",
    "building",
    "fence",
    "vegetation",
    "trunk",
    "terrain",
    "pole",
    "traffic-sign",
];

/// One SemanticKITTI id for each class of the learning map.
pub const CLASS_IDS: [u32; CLASSES] = [0, 10, 11, 15, 18, 20, 30, 31, 32, 40, 44, 48, 49, 50, 51, 70, 71, 72, 80, 81];

/// Class of the learning map (0–19) of a SemanticKITTI label; its instance bits are ignored, unknown ids are 0.
pub fn class_of(label: u32) -> u8 {
    match label & 0xffff {
        10 | 252 => 1,
        11 => 2,
        15 => 3,
        18 | 258 => 4,
        13 | 16 | 20 | 256 | 257 | 259 => 5,
        30 | 254 => 6,
        31 | 253 => 7,
        32 | 255 => 8,
        40 | 60 => 9,
        44 => 10,
        48 => 11,
        49 => 12,
        50 => 13,
        51 => 14,
        70 => 15,
        71 => 16,
        72 => 17,
        80 => 18,
        81 => 19,
        _ => 0,
    }
}

/// CARLA's two tables of semantic tags: 0.9.14 renumbered them to follow Cityscapes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CarlaTags {
    /// Before 0.9.14: 0 unlabelled, 1 building, 2 fence, … 22 terrain.
    Until0913,
    /// Since 0.9.14: 0 unlabelled, 1 road, 2 sidewalk, … 28 guard rail.
    Since0914,
}

impl CarlaTags {
    /// SemanticKITTI id of one of CARLA's tags; a tag without a counterpart (sky, water, …) is 0.
    pub fn to_label(self, tag: u32) -> u32 {
        // CARLA documentation, "Sensors reference", semantic segmentation camera, of 0.9.13 and 0.9.14.
        const UNTIL_0913: [u32; 23] =
            [0, 50, 51, 0, 30, 80, 60, 40, 48, 70, 10, 50, 81, 0, 49, 50, 49, 51, 80, 52, 99, 0, 72];
        const SINCE_0914: [u32; 29] = [
            0, 40, 48, 50, 50, 51, 80, 80, 81, 70, 72, 0, 30, 31, 10, 18, 13, 16, 15, 11, 52, 99, 99, 0, 60, 49, 50,
            49, 51,
        ];
        let table: &[u32] = match self {
            Self::Until0913 => &UNTIL_0913,
            Self::Since0914 => &SINCE_0914,
        };
        table.get(tag as usize).copied().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_class_maps_to_itself_through_its_id() {
        for (class, id) in CLASS_IDS.iter().enumerate() {
            assert_eq!(usize::from(class_of(*id)), class, "{}", CLASS_NAMES[class]);
        }
    }

    #[test]
    fn instances_and_moving_objects_keep_their_class() {
        assert_eq!(class_of(0x000c_0000 + 252), 1);
        assert_eq!(class_of(254), 6);
    }

    #[test]
    fn both_carla_tables_know_roads_and_cars() {
        let class = |tags: CarlaTags, tag| CLASS_NAMES[usize::from(class_of(tags.to_label(tag)))];
        assert_eq!([class(CarlaTags::Until0913, 7), class(CarlaTags::Until0913, 10)], ["road", "car"]);
        assert_eq!([class(CarlaTags::Since0914, 1), class(CarlaTags::Since0914, 14)], ["road", "car"]);
        assert_eq!(class(CarlaTags::Since0914, 12), "person");
        assert_eq!(CarlaTags::Since0914.to_label(1000), 0);
    }
}
