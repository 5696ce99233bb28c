//! Light samples of emissive triangles, from which light selection is learned.

use crate::color::luminance;
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::queues::{LightKind, ShadowRays};
use crate::integrator::data::requests::RequestPacket;
use crate::integrator::data::vertices::Vertices;
use crate::integrator::events::{LightSamplePacket, PathEvents, UnoccludedLight};
use crate::lanes::{U, eight, grow, mask, store_bits};
use crate::light::LightSampleRecord;
use crate::light::samples::SIZED;

/// Records the light samples of area lights.
#[derive(Debug, Default)]
pub struct LightSampleRecorder {
    /// [`LightSampleRecord::pixel`] is an index into the wave's tasks.
    records: Vec<LightSampleRecord>,
    /// By row of shadow rays toward area lights: index of the record.
    record_of: Vec<u32>,
}

impl LightSampleRecorder {
    /// Takes the records of a wave, each divided by the square root of its pixel's divisor.
    pub fn take(&mut self, divisors: &[f32]) -> Vec<LightSampleRecord> {
        let mut records = std::mem::take(&mut self.records);
        records.iter_mut().for_each(|record| record.contribution /= divisors[record.pixel as usize].sqrt());
        records
    }
}

impl PathEvents for LightSampleRecorder {
    fn begin(&mut self, _at: &WaveContext) {
        self.records.clear();
    }

    fn light_samples(
        &mut self,
        at: &WaveContext,
        _vertices: &Vertices,
        packet: &RequestPacket,
        samples: &LightSamplePacket,
    ) {
        let recorded = (mask(packet.len) & !samples.is_environment).to_bitmask();
        let (position, normal) = samples.from;
        let path = packet.path_ids.path.to_array();
        let record_of = eight(|lane| {
            let record = self.records.len() as u32;
            if recorded >> lane & 1 == 1 && samples.emitter[lane] < SIZED {
                self.records.push(LightSampleRecord {
                    position: position.lane(lane),
                    normal: normal.lane(lane),
                    emitter: samples.emitter[lane],
                    pixel: at.pixel(path[lane]) as u32,
                    contribution: 0.0,
                });
            }
            record
        });
        grow(&mut self.record_of, samples.first_row);
        store_bits(&mut self.record_of, samples.first_row, samples.survivors.compress_bits(U::from(record_of)));
    }

    fn unoccluded(&mut self, _at: &WaveContext, shadows: &ShadowRays, found: &UnoccludedLight) {
        if shadows.kind(found.row) == LightKind::Area {
            self.records[self.record_of[found.row] as usize].contribution = luminance(found.radiance);
        }
    }
}
