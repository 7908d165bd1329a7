//! `glTF` 2.0, text (.gltf) and binary (.glb).

use std::path::Path;

use glam::{Mat4, Vec3};
use gltf::accessor::{DataType, Dimensions};
use gltf::buffer;
use gltf::mesh::Mode;

use super::{LoadOptions, MeshError, names, object_error, of_object, read};
use crate::mesh::Mesh;

/// Nodes lie in each other at most this deep; a file whose nodes form a ring ends here.
const MAX_DEPTH: usize = 64;

/// What all nodes of one file need.
struct File<'a> {
    path: &'a Path,
    buffers: Vec<buffer::Data>,
    unit_m: f32,
}

/// Loads the default scene, or the first one.
pub(super) fn load(path: &Path, options: LoadOptions) -> Result<Mesh, MeshError> {
    let malformed = |problem: String| MeshError::Malformed { path: path.into(), format: "glTF", problem };
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice(&read(path)?).map_err(|e| malformed(e.to_string()))?;
    for buffer in document.buffers() {
        if let buffer::Source::Uri(uri) = buffer.source() {
            check_uri(uri).map_err(|problem| object_error(path, format!("buffer {}", buffer.index()), problem))?;
        }
    }
    let buffers = gltf::import_buffers(&document, path.parent(), blob).map_err(|e| malformed(e.to_string()))?;
    let file = File { path, buffers, unit_m: options.unit_m };
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let mut mesh = Mesh::new();
    for node in scene.iter().flat_map(gltf::Scene::nodes) {
        file.add_node(&mut mesh, &node, Mat4::IDENTITY, None, MAX_DEPTH)?;
    }
    Ok(mesh)
}

/// Only data in the file itself, or a file beside or below it.
fn check_uri(uri: &str) -> Result<(), &'static str> {
    let outside = uri.contains("..") || uri.starts_with(['/', '\\']) || uri.contains(':');
    if outside && !uri.starts_with("data:") { Err("its data is outside the file's folder") } else { Ok(()) }
}

impl File<'_> {
    fn add_node(
        &self,
        mesh: &mut Mesh,
        node: &gltf::Node<'_>,
        above: Mat4,
        label: Option<u32>,
        depth: usize,
    ) -> Result<(), MeshError> {
        let name = node.name().map_or_else(|| format!("node {}", node.index()), |name| format!("node `{name}`"));
        if depth == 0 {
            return Err(object_error(self.path, name, format!("more than {MAX_DEPTH} nodes lie in each other")));
        }
        let world = above * Mat4::from_cols_array_2d(&node.transform().matrix());
        // A node's own name says more than those above it.
        let label = node.name().and_then(names::label_of).or(label);
        if let Some(part) = node.mesh() {
            let label = part.name().and_then(names::label_of).or(label);
            for primitive in part.primitives().filter(|p| p.mode() == Mode::Triangles) {
                self.add_primitive(mesh, &primitive, world, label, &name)?;
            }
        }
        node.children().try_for_each(|child| self.add_node(mesh, &child, world, label, depth - 1))
    }

    fn add_primitive(
        &self,
        mesh: &mut Mesh,
        primitive: &gltf::Primitive<'_>,
        world: Mat4,
        label: Option<u32>,
        name: &str,
    ) -> Result<(), MeshError> {
        let fail = |problem: String| object_error(self.path, name, problem);
        let positions = primitive.get(&gltf::Semantic::Positions).ok_or_else(|| fail("no positions".into()))?;
        if (positions.dimensions(), positions.data_type()) != (Dimensions::Vec3, DataType::F32) {
            return Err(fail("positions are not three f32 each".into()));
        }
        let vertices: Vec<[f32; 3]> = self
            .elements(&positions, 12)
            .map_err(fail)?
            .map(|bytes| {
                let at = |k: usize| f32::from_le_bytes([bytes[k], bytes[k + 1], bytes[k + 2], bytes[k + 3]]);
                let p = world.transform_point3(Vec3::new(at(0), at(4), at(8))) * self.unit_m;
                // glTF: y up, z ahead, x left.
                [p.z, p.x, p.y]
            })
            .collect();
        let indices = match primitive.indices() {
            Some(accessor) => self.indices(&accessor).map_err(fail)?,
            None => (0..vertices.len() as u32).collect(),
        };
        let triangles: Vec<[u32; 3]> = indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
        let look = primitive.material();
        let label = look.name().and_then(names::label_of).or(label).unwrap_or(0);
        let [r, g, b, _] = look.pbr_metallic_roughness().base_color_factor();
        // The default material, which has no index, is plain white: nobody chose it.
        let chosen = look.index().is_some();
        let material = if chosen { names::coloured(label, [r, g, b]) } else { names::typical(label) };
        let material = mesh.add_material(material);
        mesh.add_triangles(&vertices, &triangles, material).map_err(of_object(self.path, name))
    }

    fn indices(&self, accessor: &gltf::Accessor<'_>) -> Result<Vec<u32>, String> {
        let wide = match accessor.data_type() {
            DataType::U8 => 1,
            DataType::U16 => 2,
            DataType::U32 => 4,
            other => return Err(format!("indices of type {other:?}")),
        };
        let number = |bytes: &[u8]| bytes.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte));
        Ok(self.elements(accessor, wide)?.map(number).collect())
    }

    /// The bytes of each of an accessor's elements, all of them inside its buffer.
    fn elements<'f>(
        &'f self,
        accessor: &gltf::Accessor<'_>,
        wide: usize,
    ) -> Result<impl Iterator<Item = &'f [u8]> + use<'f>, String> {
        let index = accessor.index();
        if accessor.sparse().is_some() {
            return Err(format!("accessor {index} is sparse, which is not supported"));
        }
        let view = accessor.view().ok_or_else(|| format!("accessor {index} has no buffer view"))?;
        let buffer = self.buffers.get(view.buffer().index()).map_or(&[][..], |data| &data.0);
        let stride = view.stride().unwrap_or(wide).max(wide);
        let count = accessor.count();
        let range = || {
            let start = view.offset().checked_add(accessor.offset())?;
            let length = stride.checked_mul(count.checked_sub(1)?)?.checked_add(wide)?;
            let end = start.checked_add(length)?;
            (end <= view.offset().checked_add(view.length())?).then_some(start..end)
        };
        let data = range()
            .and_then(|range| buffer.get(range))
            .ok_or_else(|| format!("accessor {index}: {count} elements do not lie inside its buffer view"))?;
        Ok((0..count).map(move |i| &data[i * stride..i * stride + wide]))
    }
}

#[cfg(test)]
mod tests {
    use super::super::load;

    type Outcome = Result<(), Box<dyn std::error::Error>>;

    /// One triangle (0,0,0) (1,0,0) (0,1,0) in `tri.bin`, seen by a node that is moved 10 up and named as given.
    fn write(folder: &std::path::Path, node: &str, count: &str) -> std::io::Result<std::path::PathBuf> {
        let corners = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        std::fs::write(folder.join("tri.bin"), corners.iter().flat_map(|c| c.to_le_bytes()).collect::<Vec<u8>>())?;
        let text = format!(
            r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],
            "nodes":[{{"name":"town","children":[1]}},{{"name":"{node}","mesh":0,"translation":[0,10,0]}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"material":0}}]}}],
            "materials":[{{"pbrMetallicRoughness":{{"baseColorFactor":[0.25,0.25,0.25,1]}}}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":{count},"type":"VEC3","min":[0,0,0],"max":[1,1,0]}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}}],"buffers":[{{"uri":"tri.bin","byteLength":36}}]}}"#
        );
        let path = folder.join("tri.gltf");
        std::fs::write(&path, text)?;
        Ok(path)
    }

    #[test]
    fn nodes_move_their_meshes_and_name_them() -> Outcome {
        let folder = tempfile::tempdir()?;
        let mesh = load(write(folder.path(), "fence_2", "3")?)?;
        assert_eq!(mesh.bounds_m(), [[0.0, 0.0, 10.0], [0.0, 1.0, 11.0]]);
        assert_eq!(mesh.material(0).label, 51);
        assert!((mesh.material(0).reflectance - 0.25).abs() < 1e-6);
        Ok(())
    }

    #[test]
    fn elements_outside_the_buffer_are_refused_by_name() -> Outcome {
        let folder = tempfile::tempdir()?;
        for count in ["4", "0", "4000000000"] {
            let error = load(write(folder.path(), "box", count)?).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(error.contains("accessor 0") || error.contains("accessors[0]"), "{count}: {error}");
        }
        let path = write(folder.path(), "box", "3")?;
        let text = std::fs::read_to_string(&path)?.replace("tri.bin", "../tri.bin");
        std::fs::write(&path, text)?;
        assert!(load(&path).is_err_and(|e| e.to_string().contains("outside the file's folder")));
        let ring =
            std::fs::read_to_string(write(folder.path(), "box", "3")?)?.replace(r#""mesh":0"#, r#""children":[0]"#);
        std::fs::write(&path, ring)?;
        assert!(load(&path).is_err());
        Ok(())
    }
}
