//! Directions from which scenes are looked at.

use clap::ValueEnum;

use crate::scene::Orbit;

/// A direction from which a scene is seen; the front of a glTF asset faces +z.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Direction {
    /// From +z
    Front,
    /// From the front, the right and above
    ThreeQuarters,
    /// From +x
    Side,
    /// From -z
    Back,
    /// From above
    Top,
    /// From -x
    Left,
    /// From below
    Bottom,
}

impl Direction {
    /// Its name on the command line.
    pub fn name(self) -> String {
        self.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default()
    }

    pub fn orbit(self) -> Orbit {
        let (azimuth, elevation) = match self {
            Self::Front => (0.0, 0.0),
            Self::ThreeQuarters => (35.0, 25.0),
            Self::Side => (90.0, 0.0),
            Self::Back => (180.0, 0.0),
            Self::Top => (0.0, 90.0),
            Self::Left => (-90.0, 0.0),
            Self::Bottom => (0.0, -90.0),
        };
        Orbit { azimuth, elevation, distance: 1.0 }
    }
}
