use super::*;
use crate::render::settings::Columns;
use crate::render::settings::part::grid_positions;
use crate::render::{Balance, Ground};

const BOTH: Columns = Columns { moments: true, aovs: true, extras: true, ground: true, layers: 2 };

#[test]
fn tiles_come_back_and_anything_else_does_not() {
    let mut tiles: Vec<_> = grid_positions([0, 0, 40, 20]).map(|at| Tile::new(at, 40, 20, BOTH)).collect();
    tiles[1].stats[3].sum = [0.1, -0.0, f64::NAN];
    let bytes = pack(&tiles).unwrap();
    let again = unpack(&bytes).unwrap();
    assert_eq!(pack(&again).unwrap(), bytes);
    let settings = |height| RenderSettings {
        width: 40,
        height,
        aovs: true,
        extras: true,
        ground: Ground::Shadow,
        light_groups: Some("key".parse().unwrap()),
        balance: Balance::SecondOrder,
        ..Default::default()
    };
    assert!(fits(&again, &settings(20)));
    assert!(!fits(&again, &settings(21)));
    for cut in [1, 3, 4, bytes.len() / 2, bytes.len() - 1] {
        assert!(unpack(&bytes[..cut]).is_none(), "{cut}");
    }
    let mut longer = bytes.clone();
    longer.extend([1, 0, 0, 0, 7]);
    assert!(unpack(&longer).is_none());
}
