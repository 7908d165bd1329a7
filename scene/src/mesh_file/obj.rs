//! Wavefront OBJ with its material library.

use std::collections::HashMap;
use std::path::Path;

use super::{LoadOptions, MeshError, Up, names, of_object, read};
use crate::mesh::{MaterialId, Mesh};

/// Loads an OBJ file. A material library that is missing is no error: many are.
pub(super) fn load(path: &Path, options: LoadOptions) -> Result<Mesh, MeshError> {
    let bytes = read(path)?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let malformed =
        |e: tobj::LoadError| MeshError::Malformed { path: path.into(), format: "OBJ", problem: e.to_string() };
    let settings =
        tobj::LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, ..Default::default() };
    // Only a plain name beside the OBJ: a stranger's file shall not choose what we open.
    let library = |name: &Path| match name.file_name() {
        Some(name) => tobj::load_mtl(folder.join(name)),
        None => Err(tobj::LoadError::OpenFileFailed),
    };
    let (models, materials) = tobj::load_obj_buf(&mut bytes.as_slice(), &settings, library).map_err(malformed)?;
    let materials = materials.unwrap_or_default();
    let mut mesh = Mesh::new();
    let mut known: HashMap<(Option<usize>, Option<u32>), MaterialId> = HashMap::new();
    for model in &models {
        let material = model.mesh.material_id.and_then(|i| Some((i, materials.get(i)?)));
        let label = material.and_then(|(_, m)| names::label_of(&m.name)).or_else(|| names::label_of(&model.name));
        let id = *known.entry((material.map(|(i, _)| i), label)).or_insert_with(|| {
            let label = label.unwrap_or(0);
            let colour = material.and_then(|(_, m)| m.diffuse);
            mesh.add_material(colour.map_or_else(|| names::typical(label), |c| names::coloured(label, c)))
        });
        let vertices: Vec<[f32; 3]> = model
            .mesh
            .positions
            .chunks_exact(3)
            .map(|p| {
                let [x, y, z] = [p[0], p[1], p[2]].map(|c| c * options.unit_m);
                if options.obj_up == Up::Y { [z, x, y] } else { [x, y, z] }
            })
            .collect();
        let triangles: Vec<[u32; 3]> = model.mesh.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
        mesh.add_triangles(&vertices, &triangles, id).map_err(of_object(path, &format!("object `{}`", model.name)))?;
    }
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use super::super::{LoadOptions, Up, load_with};

    type Outcome = Result<(), Box<dyn std::error::Error>>;

    #[test]
    fn groups_and_materials_give_labels_and_reflectances() -> Outcome {
        let folder = tempfile::tempdir()?;
        std::fs::write(
            folder.path().join("town.mtl"),
            "newmtl grey\nKd 0.5 0.5 0.5\nnewmtl Asphalt\nKd 0.1 0.1 0.1\n",
        )?;
        let path = folder.path().join("town.obj");
        let text = "mtllib town.mtl\nv 0 0 0\nv 0 0 2\nv 3 0 0\nv 3 0 2\nv 0 5 0\n\
                    o House_1\nusemtl grey\nf 1 2 5\no plane\nusemtl Asphalt\nf 1 2 4 3\n";
        std::fs::write(&path, text)?;
        let mesh = load_with(&path, LoadOptions::default())?;
        assert_eq!(mesh.len(), 3);
        assert_eq!((mesh.material(0).label, mesh.material(1).label), (50, 40));
        assert!((mesh.material(0).reflectance - 0.5).abs() < 1e-6 && (mesh.material(2).reflectance - 0.1).abs() < 1e-6);
        // y up: z becomes ahead, x left.
        assert_eq!(mesh.bounds_m(), [[0.0; 3], [2.0, 3.0, 5.0]]);
        let flat = load_with(&path, LoadOptions { obj_up: Up::Z, unit_m: 2.0 })?;
        assert_eq!(flat.bounds_m(), [[0.0; 3], [6.0, 10.0, 4.0]]);
        Ok(())
    }

    #[test]
    fn a_hostile_file_is_an_error_that_says_where() -> Outcome {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("bad.obj");
        for (text, says) in [
            ("v 0 0 0\nf 1 2 3\n", "out of bounds"),
            ("v a b c\n", "parse error"),
            ("o x\nv nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "object `x`: vertex 0"),
            ("", "no triangle"),
        ] {
            std::fs::write(&path, text)?;
            let error = load_with(&path, LoadOptions::default()).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(error.contains(says), "{text:?} gave {error:?}");
        }
        Ok(())
    }
}
