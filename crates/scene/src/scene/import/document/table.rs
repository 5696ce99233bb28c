//! The document's arrays. A faulty element is an error where something shown needs it, and a remark elsewhere.

use super::json::Json;
use crate::error::{Error, Result};

/// One of the document's arrays; indices are those of the file.
pub struct Table<T> {
    elements: Vec<Result<T>>,
    name: &'static str,
}

impl<T> Table<T> {
    /// Reads every element; what is wrong with one is kept with it.
    pub fn parse(name: &'static str, items: &[Json], mut read: impl FnMut(usize, &Json) -> Result<T>) -> Self {
        let elements = items.iter().enumerate().map(|(index, json)| read(index, json)).collect();
        Self { elements, name }
    }

    /// An element that is needed; the index has been checked.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn get(&self, index: usize) -> Result<&T> {
        self.elements[index].as_ref().map_err(Clone::clone)
    }

    pub fn len(&self) -> usize {
        self.elements.len()
    }

    /// The sound elements, with their indices.
    pub fn sound(&self) -> impl Iterator<Item = (usize, &T)> {
        self.elements.iter().enumerate().filter_map(|(index, element)| Some((index, element.as_ref().ok()?)))
    }

    /// The faulty elements' paths, and what is wrong.
    pub fn faults(&self) -> impl Iterator<Item = (String, &Error)> {
        let faulty =
            self.elements.iter().enumerate().filter_map(|(index, element)| Some((index, element.as_ref().err()?)));
        faulty.map(|(index, error)| (format!("{}[{index}]", self.name), error))
    }
}
