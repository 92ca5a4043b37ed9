//! Chunks of LAZ, each decoded by crate `laz` after its sizes were checked.

use std::io::{self, Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};

use laz::laszip::{CompressorType, LazItemType, LazVlr};
use laz::record::{LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor};
use laz::{DecompressionSelection, LazItem};

use super::gps_time::GpsTime;
use super::header::{Header, u32_at};

/// Bytes of the place of the chunk table, before the first chunk. The table is for jumping, which is not done here.
const TABLE_PLACE: i64 = 8;
/// Layers of a point of formats 6 to 10, the sizes of which stand first.
const LAYERS: usize = 9;

/// Points of one file, one after another.
pub(super) struct Unpacker<R: Read + Seek> {
    decoder: Decoder<R>,
    items: Vec<LazItem>,
    /// Points of a chunk; of layered chunks of any size the chunk says it.
    chunk: Option<u64>,
    left: u64,
    file: u64,
    record: usize,
}

enum Decoder<R: Read + Seek> {
    Sequential(SequentialPointRecordDecompressor<'static, R>),
    Layered(LayeredPointRecordDecompressor<'static, R>),
}

impl<R: Read + Seek + Send + Sync + 'static> Unpacker<R> {
    /// Takes over a source that stands where the points begin. Errors are sentences.
    pub(super) fn new(mut source: R, header: &Header) -> Result<Self, String> {
        let record = header.laszip.as_deref().ok_or("the record \"laszip encoded\" is missing")?;
        let vlr = LazVlr::read_from(record).map_err(|cause| format!("the record of LAZ: {cause}"))?;
        let compressor = vlr_compressor(record);
        if compressor != Some(CompressorType::PointWise) {
            let skipped = source.seek(SeekFrom::Current(TABLE_PLACE));
            skipped.map_err(|cause| format!("the chunk table's place: {cause}"))?;
        }
        let items = vlr.items().clone();
        check(&items, header)?;
        let layered = items.first().is_some_and(|item| item.item_type() == LazItemType::Point14);
        let decoder = match compressor {
            Some(CompressorType::PointWise | CompressorType::PointWiseChunked) if !layered => {
                Decoder::Sequential(SequentialPointRecordDecompressor::new(source))
            }
            Some(CompressorType::LayeredChunked) if layered => {
                Decoder::Layered(LayeredPointRecordDecompressor::new(source))
            }
            _ => return Err("its kind of compression does not fit its points".to_owned()),
        };
        let chunk = match compressor {
            Some(CompressorType::PointWise) => Some(u64::MAX),
            _ if !vlr.uses_variable_size_chunks() => Some(u64::from(vlr.chunk_size())),
            _ if layered => None,
            _ => return Err("chunks of different sizes in point formats 0 to 5 are not supported".to_owned()),
        };
        Ok(Self { decoder, items, chunk, left: 0, file: header.file, record: usize::from(header.record) })
    }

    /// Decodes the next point; `point` is as long as the header's records.
    pub(super) fn next_point(&mut self, point: &mut [u8]) -> io::Result<()> {
        // The decoder trusts its tables. Should damaged data lead it out of one, that is damage, not a defect here.
        let decoded = catch_unwind(AssertUnwindSafe(|| self.decode(point)));
        decoded.unwrap_or_else(|_| Err(io::Error::other("the compressed data are damaged")))
    }

    fn decode(&mut self, point: &mut [u8]) -> io::Result<()> {
        if self.left == 0 {
            self.begin_chunk()?;
        }
        let begins = self.left == 0;
        match &mut self.decoder {
            Decoder::Sequential(decoder) => decoder.decompress_next(point)?,
            Decoder::Layered(decoder) => decoder.decompress_next(point)?,
        }
        self.left = match (&self.decoder, self.chunk) {
            (_, Some(points)) if begins => points - 1,
            (Decoder::Layered(decoder), None) if begins => decoder.record_count().saturating_sub(1),
            _ => self.left - 1,
        };
        Ok(())
    }

    fn begin_chunk(&mut self) -> io::Result<()> {
        let selection = DecompressionSelection::xy_returns_channel().decompress_z().decompress_intensity();
        match &mut self.decoder {
            Decoder::Sequential(decoder) => {
                decoder.reset();
                for item in &self.items {
                    match (item.item_type(), item.version()) {
                        (LazItemType::GpsTime, 2) => decoder.add_field_decompressor(GpsTime::new()),
                        _ => decoder.set_fields_from(&vec![*item]).map_err(io::Error::other)?,
                    }
                }
                Ok(())
            }
            Decoder::Layered(decoder) => {
                decoder.reset();
                decoder.set_fields_from(&self.items).map_err(io::Error::other)?;
                decoder.set_selection(selection);
                check_layers(decoder.get_mut(), self.record, self.file)
            }
        }
    }
}

/// The decoder takes memory for each layer as the chunk says; none may be longer than the file.
fn check_layers(source: &mut (impl Read + Seek), record: usize, file: u64) -> io::Result<()> {
    let start = source.stream_position()?;
    let mut head = Vec::with_capacity(record + 4 + 4 * LAYERS);
    source.take((record + 4 + 4 * LAYERS) as u64).read_to_end(&mut head)?;
    source.seek(SeekFrom::Start(start))?;
    let sizes = (0..LAYERS).map(|layer| u64::from(u32_at(&head, record + 4 + 4 * layer)));
    let sum: u64 = sizes.sum();
    let left = file.saturating_sub(start);
    if sum > left {
        let cause = format!("a chunk at byte {start} is said to take {sum} bytes, {left} are there");
        return Err(io::Error::other(cause));
    }
    Ok(())
}

/// The first two bytes, which `LazVlr` does not give out.
fn vlr_compressor(record: &[u8]) -> Option<CompressorType> {
    match record {
        [1, 0, ..] => Some(CompressorType::PointWise),
        [2, 0, ..] => Some(CompressorType::PointWiseChunked),
        [3, 0, ..] => Some(CompressorType::LayeredChunked),
        _ => None,
    }
}

/// The first item is the point with its coordinates, and all together are as long as the header's records.
fn check(items: &[LazItem], header: &Header) -> Result<(), String> {
    let first = if header.format < 6 { LazItemType::Point10 } else { LazItemType::Point14 };
    if items.first().map(LazItem::item_type) != Some(first) {
        return Err(format!("its compressed points are not of format {}", header.format));
    }
    let size = |item: &LazItem| match item.item_type() {
        LazItemType::Byte(n) | LazItemType::Byte14(n) => u32::from(n),
        LazItemType::Point10 => 20,
        LazItemType::GpsTime => 8,
        LazItemType::RGB12 | LazItemType::RGB14 => 6,
        LazItemType::RGBNIR14 => 8,
        LazItemType::WavePacket13 | LazItemType::WavePacket14 => 29,
        LazItemType::Point14 => 30,
    };
    let sum: u32 = items.iter().map(size).sum();
    if sum != u32::from(header.record) || items.iter().any(|item| u32::from(item.size()) != size(item)) {
        return Err(format!("its compressed points take {sum} bytes, the header says {}", header.record));
    }
    Ok(())
}
