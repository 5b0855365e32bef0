//! The objects of a dataset with a catalogue: as stored in the dataset, and as bodies for the physics.

use std::path::Path;
use std::sync::Arc;

use schema::{MODELS_MAX, Model, ObjectShape};
use serde::{Serialize, Serializer};
use settings::{Reader, Setting, Value};
use simulator::{Body, bodies_of};

use crate::catalogue::{Catalogue, built_in_names};

/// A catalogue's objects. If there are none, objects are primitives.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Models {
    stored: Vec<Arc<Model>>,
    bodies: Vec<Body>,
}

impl Models {
    /// All objects of a catalogue, or what is wrong with the file or with its objects, one message each.
    fn read_catalogue(name: &str, folder: &Path) -> Result<Self, Vec<String>> {
        let models = Self::of(&Catalogue::named(name, folder).map_err(|e| vec![e])?)?;
        if models.stored.len() > MODELS_MAX {
            let got = models.stored.len();
            return Err(vec![format!("objects.catalogue must have at most {MODELS_MAX} objects, got {got}")]);
        }
        if models.is_empty() {
            return Err(vec![format!("objects.catalogue must have at least one object: {name}")]);
        }
        Ok(models)
    }

    /// A catalogue's objects as a dataset stores them.
    ///
    /// # Errors
    /// What a dataset cannot store.
    pub(crate) fn of(catalogue: &Catalogue) -> Result<Self, Vec<String>> {
        let (mut stored, mut problems) = (Vec::new(), Vec::new());
        for thing in catalogue.objects() {
            match thing.body.to_model(thing.mass_kg, thing.friction) {
                Ok(model) => {
                    problems.extend(model.problems());
                    stored.push(Arc::new(model));
                }
                Err(error) => problems.push(error.to_string()),
            }
        }
        if !problems.is_empty() {
            return Err(problems);
        }
        // The physics uses the stored shapes, now and when attempts are repeated.
        let bodies = bodies_of(&stored).map_err(|e| vec![e.to_string()])?;
        Ok(Self { stored, bodies })
    }

    /// Whether objects are primitives.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.stored.is_empty()
    }

    /// The models as stored in `meta/info.json`.
    #[must_use]
    pub fn stored(&self) -> &[Arc<Model>] {
        &self.stored
    }

    /// The bodies for the physics, in the same order.
    #[must_use]
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// The shape in a row for a body that is a primitive or one of these models.
    pub(crate) fn shape_of(&self, body: &Body) -> ObjectShape {
        if let Some(solid) = body.as_solid() {
            return solid.into();
        }
        let number = self.stored.iter().position(|model| model.name == body.name());
        let number = number.expect("a body that was let fall is a primitive or of the catalogue");
        let model = self.stored[number].clone();
        ObjectShape::Model { number: u16::try_from(number).expect("an info's models are few"), model }
    }
}

/// A setting that is read by the catalogue's name; without one, objects are primitives.
impl Setting for Models {
    type Limits = ();

    fn kind((): &()) -> String {
        format!("{}, the path of a catalogue, or left out", built_in_names())
    }

    fn read(value: &Value, (): &(), reader: &mut Reader<'_>) -> Option<Self> {
        let read = Self::read_catalogue(&String::read(value, &(), reader)?, reader.folder());
        read.map_err(|problems| problems.into_iter().for_each(|problem| reader.report(problem))).ok()
    }

    fn written(&self) -> Option<String> {
        self.stored.is_empty().then(|| "left out".to_owned())
    }
}

/// Written as the objects' names.
impl Serialize for Models {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.stored.iter().map(|model| &model.name))
    }
}
