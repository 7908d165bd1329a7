//! `CityJSON` 1.0 to 2.0: towns with classes.

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;
use serde::Deserialize;
use serde_json::{Map, Value};

use super::polygon::Cutter;
use super::{MeshError, city_object, object_error, of_object, read};
use crate::material::Material;
use crate::mesh::{MaterialId, Mesh};

/// What we need of a `CityJSON` file; the rest is passed over.
#[derive(Deserialize)]
struct City {
    #[serde(rename = "type")]
    kind: String,
    #[serde(rename = "CityObjects")]
    objects: BTreeMap<String, Object>,
    vertices: Vec<[f64; 3]>,
    transform: Option<Transform>,
}

/// Vertices are integers, to be multiplied and moved.
#[derive(Deserialize)]
struct Transform {
    scale: [f64; 3],
    translate: [f64; 3],
}

#[derive(Deserialize)]
struct Object {
    #[serde(rename = "type")]
    kind: String,
    #[serde(default)]
    attributes: Map<String, Value>,
    #[serde(default)]
    geometry: Vec<Geometry>,
}

#[derive(Deserialize)]
struct Geometry {
    #[serde(rename = "type")]
    kind: String,
    #[serde(default)]
    lod: Value,
    #[serde(default)]
    boundaries: Value,
    semantics: Option<Semantics>,
}

#[derive(Deserialize)]
struct Semantics {
    surfaces: Vec<Semantic>,
    #[serde(default)]
    values: Value,
}

#[derive(Deserialize)]
struct Semantic {
    #[serde(rename = "type")]
    kind: String,
}

/// Loads a town: its middle becomes x = y = 0, its lowest vertex z = 0, east x and north y.
pub(super) fn load(path: &Path) -> Result<Mesh, MeshError> {
    let malformed = |problem: String| MeshError::Malformed { path: path.into(), format: "CityJSON", problem };
    let city: City = serde_json::from_slice(&read(path)?).map_err(|e| malformed(e.to_string()))?;
    if city.kind != "CityJSON" {
        return Err(malformed(format!("type is `{}`, expected `CityJSON`", city.kind)));
    }
    let mut town = Town { path, vertices: local_vertices(&city), mesh: Mesh::new(), cutter: Cutter::new() };
    for (name, object) in &city.objects {
        town.add(name, object)?;
    }
    Ok(town.mesh)
}

/// Real coordinates relative to the town's middle: a national grid's are far too large for `f32`.
fn local_vertices(city: &City) -> Vec<DVec3> {
    let (scale, translate) = city
        .transform
        .as_ref()
        .map_or((DVec3::ONE, DVec3::ZERO), |t| (DVec3::from_array(t.scale), DVec3::from_array(t.translate)));
    let real: Vec<DVec3> = city.vertices.iter().map(|v| DVec3::from_array(*v) * scale + translate).collect();
    let Some(first) = real.first() else { return real };
    let (low, high) = real.iter().fold((*first, *first), |(low, high), v| (low.min(*v), high.max(*v)));
    let middle = (0.5 * (low + high)).with_z(low.z);
    real.into_iter().map(|v| v - middle).collect()
}

struct Town<'a> {
    path: &'a Path,
    vertices: Vec<DVec3>,
    mesh: Mesh,
    cutter: Cutter,
}

impl Town<'_> {
    fn add(&mut self, name: &str, object: &Object) -> Result<(), MeshError> {
        let fail = |path: &Path, problem: String| object_error(path, format!("object `{name}`"), problem);
        // An object may come in several levels of detail: the finest one is the object.
        let Some(geometry) = object.geometry.iter().max_by(|a, b| lod(a).total_cmp(&lod(b))) else { return Ok(()) };
        // Levels of lists around a surface, which is itself a list of rings.
        let around = match geometry.kind.as_str() {
            "MultiSurface" | "CompositeSurface" => 1,
            "Solid" => 2,
            "MultiSolid" | "CompositeSolid" => 3,
            "MultiPoint" | "MultiLineString" => return Ok(()),
            other => return Err(fail(self.path, format!("geometry of type `{other}` is not supported"))),
        };
        let material = city_object::material(&object.kind, &object.attributes, name);
        let mut surfaces = Vec::new();
        let values = geometry.semantics.as_ref().map_or(&Value::Null, |s| &s.values);
        collect(&geometry.boundaries, values, around, &mut surfaces).map_err(|e| fail(self.path, e.into()))?;
        let mut known: Vec<(Material, MaterialId)> = Vec::new();
        for (rings, value) in surfaces {
            let kinds = geometry.semantics.as_ref().map_or(&[][..], |s| &s.surfaces);
            let kind = value.and_then(|i| kinds.get(i)).map(|s| s.kind.as_str());
            let material = city_object::surface(kind, material);
            let id = if let Some((_, id)) = known.iter().find(|(m, _)| *m == material) {
                *id
            } else {
                let id = self.mesh.add_material(material);
                known.push((material, id));
                id
            };
            let rings = self.rings(rings).map_err(|e| fail(self.path, e))?;
            let corners: Vec<[f32; 3]> = rings.iter().flatten().map(|v| v.map(|c| c as f32)).collect();
            let triangles = self.cutter.cut(&rings);
            let of = of_object(self.path, name);
            self.mesh.add_triangles(&corners, &triangles, id).map_err(of)?;
        }
        Ok(())
    }

    /// The rings' vertices in place of their indices.
    fn rings(&self, rings: &[Value]) -> Result<Vec<Vec<[f64; 3]>>, String> {
        let vertex = |index: &Value| {
            let at = index.as_u64().and_then(|i| self.vertices.get(usize::try_from(i).ok()?));
            at.map(DVec3::to_array).ok_or_else(|| format!("vertex {index}, of {}", self.vertices.len()))
        };
        let ring = |ring: &Value| {
            let indices = ring.as_array().ok_or_else(|| format!("a ring is {ring}, expected a list of vertices"))?;
            indices.iter().map(vertex).collect()
        };
        rings.iter().map(ring).collect()
    }
}

fn lod(geometry: &Geometry) -> f64 {
    match &geometry.lod {
        Value::String(text) => text.parse().unwrap_or(0.0),
        other => other.as_f64().unwrap_or(0.0),
    }
}

/// Gathers the surfaces that lie `around` lists deep, each with the number of its semantics, which are nested alike.
fn collect<'v>(
    boundaries: &'v Value,
    values: &Value,
    around: usize,
    to: &mut Vec<(&'v [Value], Option<usize>)>,
) -> Result<(), &'static str> {
    let list = boundaries.as_array().ok_or("its boundaries are not nested as its type says")?;
    if around == 0 {
        to.push((list, values.as_u64().and_then(|v| usize::try_from(v).ok())));
        return Ok(());
    }
    for (i, inner) in list.iter().enumerate() {
        // A null stands for everything below it.
        collect(inner, values.get(i).unwrap_or(&Value::Null), around - 1, to)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::load;

    type Outcome = Result<(), Box<dyn std::error::Error>>;

    fn town(boundaries: &str) -> String {
        format!(
            r#"{{"type":"CityJSON","version":"2.0","transform":{{"scale":[0.5,0.5,0.5],"translate":[84616.0,447422.0,-3.0]}},
            "CityObjects":{{"shed":{{"type":"Building","geometry":[
              {{"type":"MultiSurface","lod":"1","boundaries":[[[0,1,2]]]}},
              {{"type":"Solid","lod":"2.2","boundaries":{boundaries},
                "semantics":{{"surfaces":[{{"type":"WallSurface"}},{{"type":"Window"}}],"values":[[0,1]]}}}}]}},
              "path":{{"type":"Road","attributes":{{"function":"voetpad"}},"geometry":[
              {{"type":"MultiSurface","lod":1,"boundaries":[[[0,1,2]]]}}]}}}},
            "vertices":[[0,0,0],[20,0,0],[20,0,8],[0,0,8],[4,0,2],[8,0,2],[8,0,4],[4,0,4]]}}"#
        )
    }

    #[test]
    fn a_town_comes_with_its_classes_around_its_own_origin() -> Outcome {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("town.json");
        std::fs::write(&path, town("[[[[0,1,2,3],[4,7,6,5]],[[4,5,6,7]]]]"))?;
        let mesh = load(&path)?;
        let labels: Vec<u32> = (0..mesh.len()).map(|i| mesh.material(i).label).collect();
        assert_eq!(labels.iter().filter(|l| **l == 48).count(), 1, "one footpath");
        // A square with a square hole is 8 triangles; the pane in it 2.
        assert_eq!(labels.iter().filter(|l| **l == 50).count(), 10);
        assert!((0..mesh.len()).any(|i| mesh.material(i).reflectance < 0.07), "the pane is dark");
        assert_eq!(mesh.bounds_m(), [[-5.0, 0.0, 0.0], [5.0, 0.0, 4.0]]);
        Ok(())
    }

    #[test]
    fn a_broken_town_names_the_object() -> Outcome {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("town.json");
        for (boundaries, says) in [
            ("[[[[0,1,99]]]]", "object `shed`: vertex 99, of 8"),
            ("[[[[0,-1,2]]]]", "vertex -1"),
            ("[[[0,1,2]]]", "a ring is 0"),
            ("7", "object `shed`: its boundaries"),
        ] {
            std::fs::write(&path, town(boundaries))?;
            let error = load(&path).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(error.contains(says), "{boundaries} gave {error:?}");
        }
        std::fs::write(&path, r#"{"type":"FeatureCollection","CityObjects":{},"vertices":[]}"#)?;
        assert!(load(&path).is_err_and(|e| e.to_string().contains("expected `CityJSON`")));
        Ok(())
    }
}
