//! Axes: from values to positions, and where the ticks go.

/// Mapping of values to positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    Linear,
    /// Logarithmic; values ≤ 0 are omitted.
    Log,
}

/// An axis, fitted to its values.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    scale: Scale,
    low: f64,
    high: f64,
}

impl Axis {
    /// An axis on which all of the values that the scale can show have a position.
    pub fn fit(scale: Scale, values: impl Iterator<Item = f64>) -> Self {
        let shown = values.filter(|v| v.is_finite() && (scale == Scale::Linear || *v > 0.0));
        let (low, high) = shown.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let (low, high) = match scale {
            _ if low > high => (1.0, 2.0),
            Scale::Log => (low * 0.8, high * 1.25),
            Scale::Linear => {
                let room = if high > low { 0.05 * (high - low) } else { 0.5 * high.abs().max(1e-9) };
                (low - room, high + room)
            }
        };
        Self { scale, low, high }
    }

    pub fn new(scale: Scale, low: f64, high: f64) -> Self {
        Self { scale, low, high }
    }

    /// Position of a value: 0 at the low end, 1 at the high end; `None` outside of the axis.
    pub fn position(&self, value: f64) -> Option<f64> {
        let of = |v: f64| if self.scale == Scale::Log { v.log10() } else { v };
        let position = (of(value) - of(self.low)) / (of(self.high) - of(self.low));
        (position.is_finite() && (-1e-9..=1.0 + 1e-9).contains(&position)).then_some(position)
    }

    /// [`position`](Self::position), values beyond an end at that end.
    pub fn clamped(&self, value: f64) -> Option<f64> {
        if value.is_nan() { None } else { self.position(value.clamp(self.low, self.high)) }
    }

    pub(crate) fn is_log(&self) -> bool {
        self.scale == Scale::Log
    }

    /// Values to write at the axis, rising, three to eight.
    pub(crate) fn ticks(&self) -> Vec<f64> {
        let within = |v: &f64| (self.low..=self.high).contains(v);
        if self.scale == Scale::Log {
            let (first, last) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
            let at = |digits: &[f64], every: i32| {
                let decades = (first..=last).filter(|d| (d - first) % every == 0);
                decades.flat_map(|d| digits.iter().map(move |x| x * 10f64.powi(d))).filter(within).collect::<Vec<_>>()
            };
            let tries =
                [at(&[1.0, 2.0, 5.0], 1), at(&[1.0, 3.0], 1), at(&[1.0], 1), at(&[1.0], 1 + (last - first) / 7)];
            if let Some(ticks) = tries.into_iter().find(|ticks| (3..=7).contains(&ticks.len())) {
                return ticks;
            }
            // Less than a decade, or so.
        }
        let unit = 10f64.powf((self.high - self.low).log10().floor());
        let at = |step: f64| {
            let (first, last) = ((self.low / step).ceil() as i64, (self.high / step).floor() as i64);
            (first..=last).map(|i| i as f64 * step).filter(within).collect::<Vec<_>>()
        };
        // The widest step that leaves three.
        let tries = [2.0, 1.0, 0.5, 0.2, 0.1].map(|step| at(step * unit));
        tries.into_iter().find(|ticks| ticks.len() >= 3).unwrap_or_default()
    }
}

pub(crate) fn tick_text(value: f64) -> String {
    let text = match value.abs() {
        0.0 => "0".to_owned(),
        a if (1e-3..1e5).contains(&a) => {
            let text = format!("{value:.4}");
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        }
        _ => format!("{value:.0e}"),
    };
    text.replacen('-', "−", 1).replace("e-", "e−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_few_and_on_the_axis() {
        let more = (1..200).map(|i| (0.37, 0.37 * 1.04f64.powi(i)));
        for (low, high) in [(0.0, 1.0), (-3.0, 17.0), (0.61, 0.63), (1e-5, 3e-2), (0.5, 900.0)].into_iter().chain(more)
        {
            for scale in [Scale::Linear, Scale::Log] {
                if scale == Scale::Log && low <= 0.0 {
                    continue;
                }
                let axis = Axis::fit(scale, [low, high].into_iter());
                let ticks = axis.ticks();
                assert!((3..=9).contains(&ticks.len()), "{low} {high} {ticks:?}");
                assert!(ticks.iter().all(|t| axis.position(*t).is_some()), "{ticks:?}");
            }
        }
        assert_eq!(Axis::new(Scale::Log, 0.5, 60.0).ticks(), [0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0]);
        assert_eq!(tick_text(0.25), "0.25");
        assert_eq!(tick_text(1e-5), "1e−5");
        assert_eq!(tick_text(100.0), "100");
    }

    #[test]
    fn what_cannot_be_shown_has_no_position() {
        let axis = Axis::fit(Scale::Log, [0.0, 1.0, 10.0, f64::NAN, -3.0].into_iter());
        assert!(axis.position(0.0).is_none() && axis.position(f64::NAN).is_none() && axis.position(100.0).is_none());
        assert!((axis.clamped(100.0).unwrap() - 1.0).abs() < 1e-12);
        assert!(axis.position(3.0).is_some());
        assert!(Axis::fit(Scale::Linear, std::iter::empty()).position(1.5).is_some());
    }
}
