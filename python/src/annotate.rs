//! `graspmill.annotate`: labelled grasps of an object alone, with progress and Ctrl-C.

use std::path::PathBuf;
use std::sync::atomic::Ordering;

use ::generator::catalogue::CatalogueObject;
use ::generator::{AnnotateParams, Annotated, GraspShares, ImportParams};
use numpy::PyReadonlyArray2;
use program::{ExitCode, Failure};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use schema::{GripTest, ObjectGrasps, Vec3};
use shards::PlainColumn;

use crate::fault::{array, room, wrong};
use crate::pool::Apart;
use crate::scene::{Body, Simulation, poses};

/// Memory for a grasp and what is known of it, in bytes.
const GRASP_BYTES: usize = 512;

/// The annotation of an object, under way.
#[pyclass(module = "graspmill._native")]
#[derive(Debug)]
pub(crate) struct Annotation {
    work: Apart<ObjectGrasps>,
    set: Option<ObjectGrasps>,
}

/// How grasps are drawn and tried, as Python has it: number, whether only what holds is kept, shares, test, the largest
/// touch in metres, whether margins, repeats, drops, seed.
type PlainParams = (usize, bool, [f32; 3], String, f32, bool, u32, u32, u64);

#[pymethods]
impl Annotation {
    /// Begins that of a body with its mass, friction and place in the frame of its grasps, or of a file with so many
    /// metres a unit; with what was made of a description.
    #[new]
    fn new(
        body: Option<(Py<Body>, f32, f32, [f32; 3])>,
        file: Option<(PathBuf, Option<f64>, Option<PathBuf>)>,
        simulation: &Simulation,
        params: PlainParams,
        given: Option<PyReadonlyArray2<'_, f32>>,
        threads: usize,
    ) -> PyResult<Self> {
        let (grasps, is_held_only, [antipodal, normal, displaced], test, touch_m_max, margins, repeats, drops, seed) =
            params;
        let test = GripTest::from_name(&test).ok_or_else(|| {
            wrong(format!("test must be one of {}, got {test:?}", GripTest::ALL.map(GripTest::name).join(", ")))
        })?;
        let given = given.map(|rows| poses(&rows));
        room(GRASP_BYTES * given.as_ref().map_or(grasps, Vec::len))?;
        let params = AnnotateParams {
            gripper: simulation.gripper.clone(),
            grasps,
            is_held_only,
            shares: GraspShares { antipodal, normal, displaced },
            test,
            touch_m_max,
            margins,
            repeats,
            drops,
            seed,
            ..AnnotateParams::default()
        };
        let of_body = body.map(|(body, mass_kg, friction, origin_m)| {
            let object = CatalogueObject { body: body.get().body().clone(), mass_kg, friction, origin_m: Vec3::ZERO };
            let (file, origin_m) = (String::new(), Vec3::from_array(origin_m));
            Annotated { object, file, file_sha256: None, scale_m: 1.0, origin_m, warnings: Vec::new() }
        });
        let work = Apart::start(threads, move |_, counts| {
            let annotated = match of_body {
                Some(annotated) => annotated,
                None => of_file(file)?,
            };
            let mut go_on = |made: usize| {
                counts.done.store(made as u64, Ordering::Relaxed);
                !counts.stop.load(Ordering::Relaxed)
            };
            let set = match &given {
                Some(given) => ::generator::relabel(&annotated, &params, given, &mut go_on),
                None => ::generator::annotate(&annotated, &params, &mut go_on),
            };
            set.ok_or_else(|| Failure::new(ExitCode::TryAgain, "the annotation was stopped"))
        })?;
        Ok(Self { work, set: None })
    }

    /// How many grasps there are.
    #[getter]
    fn made(&self) -> u64 {
        self.work.counts.told()[0]
    }

    /// Whether it ends within a moment.
    fn has_ended(&mut self, py: Python<'_>) -> PyResult<bool> {
        if self.set.is_none() {
            self.set = self.work.soon(py)?;
        }
        Ok(self.set.is_some())
    }

    /// What is said of the object, as JSON.
    fn info(&self) -> PyResult<String> {
        Ok(inspect::grasps_info(self.done()?).to_string())
    }

    /// The columns of the set's table by their names, NaN where a number is not known.
    fn columns<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let columns = PyDict::new(py);
        for (name, column) in inspect::grasp_columns(self.done()?) {
            match column {
                PlainColumn::Whole(values) => columns.set_item(name, array(py, values)?)?,
                PlainColumn::Real(values) => {
                    let values = values.into_iter().map(|value| value.unwrap_or(f32::NAN)).collect();
                    columns.set_item(name, array(py, values)?)?;
                }
                PlainColumn::Text(values) => columns.set_item(name, values)?,
            }
        }
        Ok(columns)
    }
}

impl Annotation {
    fn done(&self) -> PyResult<&ObjectGrasps> {
        self.set.as_ref().ok_or_else(|| wrong("the annotation has not ended"))
    }
}

fn of_file(file: Option<(PathBuf, Option<f64>, Option<PathBuf>)>) -> Result<Annotated, Failure> {
    let refused = |text: String| Failure::new(ExitCode::Config, text);
    let (path, scale, described) = file.ok_or_else(|| refused("an object or a file must be given".to_owned()))?;
    let params = ImportParams { scale, described, ..ImportParams::default() };
    let (mut objects, _) = Annotated::read(std::slice::from_ref(&path), &params, &|_| Ok(()), &|_, _| {})?;
    match (objects.pop(), objects.len()) {
        (Some(object), 0) => Ok(object),
        (_, more) => Err(refused(format!("the file must have one object, got {}: {}", more + 1, path.display()))),
    }
}
