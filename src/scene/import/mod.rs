//! Files into a [`Scene`](super::Scene): glTF 2.0 and its extensions, pictures, environments. Nothing in a file is trusted.
