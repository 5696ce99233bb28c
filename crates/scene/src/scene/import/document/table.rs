//! The document's arrays. A faulty element is an error if something shown needs it; otherwise it is noted.

use super::json::Json;
use crate::error::{Error, Result};

/// An array of the document; indices are those of the file.
pub struct Table<T> {
    elements: Vec<Result<T>>,
    name: &'static str,
}

impl<T> Table<T> {
    /// Reads every element of the array with this path; errors are kept in the element's place.
    ///
    /// # Errors
    /// A member that should be an array and is not.
    pub fn parse(root: &Json, name: &'static str, mut read: impl FnMut(usize, &Json) -> Result<T>) -> Result<Self> {
        let elements = root.items(name)?.iter().enumerate().map(|(index, json)| read(index, json)).collect();
        Ok(Self { elements, name })
    }

    /// The element at a checked index.
    ///
    /// # Errors
    /// The element's fault.
    pub fn get(&self, index: usize) -> Result<&T> {
        self.elements[index].as_ref().map_err(Clone::clone)
    }

    /// Replaces the element at a checked index.
    pub fn set(&mut self, index: usize, element: Result<T>) {
        self.elements[index] = element;
    }

    pub fn len(&self) -> usize {
        self.elements.len()
    }

    /// The valid elements, with their indices.
    pub fn sound(&self) -> impl Iterator<Item = (usize, &T)> {
        self.elements.iter().enumerate().filter_map(|(index, element)| Some((index, element.as_ref().ok()?)))
    }

    /// JSON paths of the faulty elements, with their faults.
    pub(crate) fn faults(&self) -> impl Iterator<Item = (String, &Error)> {
        let faulty =
            self.elements.iter().enumerate().filter_map(|(index, element)| Some((index, element.as_ref().err()?)));
        faulty.map(|(index, error)| (format!("{}[{index}]", self.name), error))
    }
}
