//! A parser of the attributes at the head of an OpenEXR file, which trusts no count in them.

use std::io::{self, ErrorKind, Read};

/// Largest total size of all attributes in bytes. Our pictures have some thousand; others have a preview or a manifest of names.
const MAX_HEAD_BYTES: u64 = 16 << 20;
/// Largest number of attributes of all parts together.
const MAX_ATTRIBUTES: u32 = 1 << 16;
pub const MAGIC: [u8; 4] = [0x76, 0x2F, 0x31, 0x01];
/// The flag of files with several parts, in the word after the magic number.
const MULTIPART: u32 = 1 << 12;

#[derive(Debug)]
pub struct Attribute<'a> {
    pub part: u32,
    pub name: &'a [u8],
    /// Position of the value in the file, in bytes.
    pub at: u64,
    pub value: &'a [u8],
}

/// Calls `visit` with the attributes of all parts, up to the first error.
/// Errors: [`ErrorKind::InvalidData`] for an invalid head or one larger than [`MAX_HEAD_BYTES`],
/// [`ErrorKind::UnexpectedEof`] for a truncated one, and errors of the reader.
pub fn walk(from: impl Read, visit: &mut dyn FnMut(Attribute)) -> io::Result<()> {
    let mut walk = Walk { from, at: 0 };
    if walk.take(4)? != MAGIC {
        return Err(invalid("it does not begin as OpenEXR files do"));
    }
    let version = u32::from_le_bytes(walk.take(4)?.try_into().unwrap_or_default());
    let mut part = 0;
    for _ in 0..MAX_ATTRIBUTES {
        let mut name = walk.text()?;
        if name.is_empty() && version & MULTIPART != 0 {
            part += 1;
            // The headers of several parts end with an empty one.
            name = walk.text()?;
        }
        if name.is_empty() {
            return Ok(());
        }
        walk.attribute(part, &name, visit)?;
    }
    Err(invalid(format!("it has more than {MAX_ATTRIBUTES} attributes")))
}

struct Walk<R> {
    from: R,
    at: u64,
}

impl<R: Read> Walk<R> {
    fn take(&mut self, length: u64) -> io::Result<Vec<u8>> {
        self.at += length;
        if self.at > MAX_HEAD_BYTES {
            return Err(invalid(format!("its attributes are more than {} MiB", MAX_HEAD_BYTES >> 20)));
        }
        let mut bytes = Vec::new();
        (&mut self.from).take(length).read_to_end(&mut bytes)?;
        if (bytes.len() as u64) < length {
            return Err(io::Error::new(ErrorKind::UnexpectedEof, "it is cut off"));
        }
        Ok(bytes)
    }

    /// Bytes up to a zero, which is not included.
    fn text(&mut self) -> io::Result<Vec<u8>> {
        let mut text = Vec::new();
        loop {
            match self.take(1)?[0] {
                0 => return Ok(text),
                _ if text.len() == 255 => return Err(invalid("a name in it is longer than 255 bytes")),
                byte => text.push(byte),
            }
        }
    }

    fn attribute(&mut self, part: u32, name: &[u8], visit: &mut dyn FnMut(Attribute)) -> io::Result<()> {
        // The name of the type.
        self.text()?;
        let length = i32::from_le_bytes(self.take(4)?.try_into().unwrap_or_default());
        let length = u64::try_from(length).map_err(|_| invalid("an attribute in it has a negative length"))?;
        let at = self.at;
        let value = self.take(length)?;
        visit(Attribute { part, name, at, value: &value });
        Ok(())
    }
}

fn invalid(why: impl Into<String>) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, why.into())
}
