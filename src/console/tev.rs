//! Shows a render in progress in the viewer tev (github.com/Tom94/tev), by its network protocol.

use std::fmt::{self, Display};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpStream, ToSocketAddrs};
use std::str::FromStr;
use std::time::Duration;

use tev_client::{PacketCreateImage, PacketUpdateImage, TevClient};

use crate::film::{Pixels, colors};
use crate::{Error, Result};

/// Network address of tev: `HOST:PORT`, `HOST`, or `:PORT` on this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Address {
    host: String,
    port: u16,
}

/// tev's default address.
pub const DEFAULT: &str = "127.0.0.1:14158";
const PORT: u16 = 14158;

/// Time limit of connecting and writing.
const TIMEOUT: Duration = Duration::from_secs(3);

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let wrong = || format!("not HOST:PORT, as in {DEFAULT}; --tev alone, which means that, stands after the scene");
        let (host, port) = match text.rsplit_once(':') {
            Some((host, port)) => (host, port.parse().map_err(|_| wrong())?),
            None => (text, PORT),
        };
        let host = host.trim_start_matches('[').trim_end_matches(']');
        let fits = host.chars().all(|c| c.is_alphanumeric() || "-._:".contains(c)) && !host.ends_with(".glb");
        if !fits || host.ends_with(".gltf") {
            return Err(wrong());
        }
        let host = if host.is_empty() { Ipv4Addr::LOCALHOST.to_string() } else { host.into() };
        Ok(Self { host, port })
    }
}

impl Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "[{}]:{}", self.host, self.port)
    }
}

/// A connection to tev, and the picture's name there.
#[derive(Debug)]
pub struct Tev {
    client: TevClient,
    name: String,
}

const CHANNELS: [&str; 3] = ["R", "G", "B"];

impl Tev {
    /// Connects and creates a black picture of the window's size.
    /// Errors: [`Error::Host`] with the address if tev cannot be reached.
    pub fn open(address: &Address, name: &str, [x0, y0, x1, y1]: [u32; 4]) -> Result<Self> {
        let Address { host, port } = address;
        let failed = |why: String| Error::Host(format!("tev at {host}:{port}: {why}"));
        let addresses: Vec<SocketAddr> = match host.parse::<IpAddr>() {
            Ok(ip) => vec![(ip, *port).into()],
            Err(_) => (host.as_str(), *port).to_socket_addrs().map_err(|e| failed(e.to_string()))?.collect(),
        };
        let socket = addresses.iter().find_map(|address| TcpStream::connect_timeout(address, TIMEOUT).ok());
        let socket = socket.ok_or_else(|| failed("nobody answers".into()))?;
        socket.set_write_timeout(Some(TIMEOUT)).map_err(|e| failed(e.to_string()))?;
        let mut client = TevClient::wrap(socket);
        let name = name.replace('\0', "");
        let create = PacketCreateImage {
            image_name: &name,
            grab_focus: true,
            width: x1 - x0,
            height: y1 - y0,
            channel_names: &CHANNELS,
        };
        client.send(create).map_err(|e| failed(e.to_string()))?;
        Ok(Self { client, name })
    }

    /// Sends the window's linear radiance.
    /// Errors: [`Error::Io`] if it cannot be sent.
    pub fn show(&mut self, pixels: &dyn Pixels) -> Result<()> {
        let [x0, y0, x1, y1] = pixels.window();
        let data: Vec<f32> = colors(pixels).1.flatten().collect();
        let update = PacketUpdateImage {
            image_name: &self.name,
            grab_focus: false,
            channel_names: &CHANNELS,
            channel_offsets: &[0, 1, 2],
            channel_strides: &[3, 3, 3],
            x: 0,
            y: 0,
            width: x1 - x0,
            height: y1 - y0,
            data: &data,
        };
        self.client.send(update).map_err(|e| Error::Io(format!("tev: cannot send the picture: {e}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_on_this_machine_unless_they_say_otherwise() {
        let of = |host: &str, port| Ok(Address { host: host.into(), port });
        assert_eq!(DEFAULT.parse(), of("127.0.0.1", 14158));
        assert_eq!(":99".parse(), of("127.0.0.1", 99));
        assert_eq!("desk.local".parse(), of("desk.local", 14158));
        assert_eq!("[::1]:7".parse(), of("::1", 7));
        for bad in ["a:b", "scene.glb", "../scene.gltf", "host:99999", "a b"] {
            assert!(bad.parse::<Address>().is_err(), "{bad}");
        }
    }
}
