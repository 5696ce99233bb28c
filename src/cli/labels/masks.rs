//! Masks of ids as run lengths.

use std::collections::BTreeMap;

use serde::Serialize;

/// A mask as COCO's run lengths: of 0, of 1, of 0, … column by column.
#[derive(Debug, PartialEq, Serialize)]
pub struct RunLengths {
    pub counts: Vec<usize>,
    /// Height and width.
    pub size: [usize; 2],
}

pub struct Mask {
    pub segmentation: RunLengths,
    pub area: usize,
    /// Left, top, width, height in pixels.
    pub bbox: [usize; 4],
}

/// The mask of each id but 0, by id.
pub fn masks(ids: &[u32], [width, height]: [usize; 2]) -> BTreeMap<u32, Mask> {
    /// Runs so far, the end of the last one in column order, and the box: left, top, right, bottom.
    struct Open {
        counts: Vec<usize>,
        end: usize,
        bounds: [usize; 4],
        area: usize,
    }
    let mut open: BTreeMap<u32, Open> = BTreeMap::new();
    for (at, (x, y)) in (0..width).flat_map(|x| (0..height).map(move |y| (x, y))).enumerate() {
        let id = ids[y * width + x];
        if id == 0 {
            continue;
        }
        let new = || Open { counts: vec![0, 0], end: 0, bounds: [x, y, x, y], area: 0 };
        let mask = open.entry(id).or_insert_with(new);
        if mask.area == 0 {
            mask.counts[0] = at;
        } else if mask.end < at {
            mask.counts.extend([at - mask.end, 0]);
        }
        if let Some(run) = mask.counts.last_mut() {
            *run += 1;
        }
        let [left, top, right, bottom] = mask.bounds;
        mask.bounds = [left.min(x), top.min(y), right.max(x), bottom.max(y)];
        (mask.end, mask.area) = (at + 1, mask.area + 1);
    }
    let closed = |(id, Open { mut counts, end, bounds: [left, top, right, bottom], area })| {
        if end < width * height {
            counts.push(width * height - end);
        }
        let segmentation = RunLengths { counts, size: [height, width] };
        (id, Mask { segmentation, area, bbox: [left, top, right - left + 1, bottom - top + 1] })
    };
    open.into_iter().map(closed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn run_lengths_are_the_mask_column_by_column(
            (width, height) in (1usize..9, 1usize..9), seeds in proptest::collection::vec(0u32..4, 64)
        ) {
            let ids: Vec<u32> = seeds[..width * height].to_vec();
            let found = masks(&ids, [width, height]);
            for id in 1..4 {
                let pixels: Vec<_> = (0..ids.len()).filter(|i| ids[*i] == id).map(|i| (i % width, i / width)).collect();
                let Some(Mask { segmentation, area, bbox: [x, y, w, h] }) = found.get(&id) else {
                    prop_assert!(pixels.is_empty());
                    continue;
                };
                prop_assert_eq!(*area, pixels.len());
                prop_assert_eq!(segmentation.counts.iter().sum::<usize>(), ids.len());
                let mut decoded = Vec::new();
                for (i, count) in segmentation.counts.iter().enumerate() {
                    decoded.extend(std::iter::repeat_n(i % 2 == 1, *count));
                }
                for (at, inside) in decoded.into_iter().enumerate() {
                    prop_assert_eq!(inside, ids[at % height * width + at / height] == id);
                }
                let extent = |of: &dyn Fn(&(usize, usize)) -> usize| {
                    (pixels.iter().map(of).min().unwrap(), pixels.iter().map(of).max().unwrap() + 1)
                };
                prop_assert_eq!(extent(&|p| p.0), (*x, x + w));
                prop_assert_eq!(extent(&|p| p.1), (*y, y + h));
            }
        }
    }
}
