#include <dcmtk/config/osconfig.h>

#include <dcmtk/dcmdata/dccodec.h>
#include <dcmtk/dcmdata/dcdeftag.h>
#include <dcmtk/dcmdata/dcpixseq.h>

#include <algorithm>
#include <cstring>

#include "volume_io/dicom/dicom_images.h"
#include "volume_io/dicom/dicom_jpeg2000.h"
#include "volume_io/dicom/dicom_readers.h"
#include "volume_io/dicom/dicom_rle.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

class FilePixels : public DicomPixels {
 public:
  static Result<std::unique_ptr<DicomPixels>> open(const std::filesystem::path& name) {
    auto file = std::make_unique<FilePixels>();
    DcmElement* element = nullptr;
    if (load(file->file_, name) == Loaded::kWhole &&
        file->file_.getDataset()->findAndGetElement(DCM_PixelData, element).good())
      file->pixels_ = dynamic_cast<DcmPixelData*>(element);
    if (!file->pixels_)
      return bad_input("", "can no longer be read", "do not change the files while they are read");
    file->find_fragments();
    return std::unique_ptr<DicomPixels>(std::move(file));
  }

  Result<void> read(const DicomFrame& frame, std::span<std::int64_t> values) override;

 private:
  void find_fragments();
  Result<void> read_bits_of(const DicomFrame& frame, std::span<std::int64_t> values);
  // decompresses a frame into buffer_; errors as read()
  Result<void> unpack(const DicomFrame& frame, std::uint64_t bytes);
  // false: damaged
  bool fetch(const DicomFrame& frame, std::uint64_t bytes);
  Result<void> unpack_wavelets(const DicomFrame& frame);
  // preparation and decoding by DCMTK; false: damaged
  bool isolate();
  bool decode(const DicomFrame& frame, std::uint8_t fill, std::uint64_t bytes);

  DcmFileFormat file_;
  DcmFileCache cache_;
  DcmPixelData* pixels_ = nullptr;
  std::vector<DcmPixelItem*> fragments_;
  std::vector<std::size_t> first_of_frame_;  // index of each frame's first fragment, and the total number of
                                             // fragments at the end
  std::vector<std::uint8_t> buffer_, packed_;
  std::unique_ptr<DcmPixelSequence> isolated_;  // the fragment of a single frame
};

// Assigns fragments to frames: one each, all to the only frame, or by the offset table, whose offsets count
// from the first fragment and include the 8-byte header of each (PS3.5 A.4). Leaves first_of_frame_ empty if
// this is ambiguous.
void FilePixels::find_fragments() {
  DcmDataset& root = *file_.getDataset();
  fragments_ = fragments_of(*pixels_, root.getOriginalXfer());
  const double frames = number_of(root, DCM_NumberOfFrames).value_or(1);
  const std::size_t packed = fragments_.size() - std::min<std::size_t>(fragments_.size(), 1);
  if (packed == 0) return;
  if (frames == 1) {
    first_of_frame_ = {1, fragments_.size()};
    return;
  }
  std::vector<std::uint8_t> table;
  constexpr Uint32 kMaxTable = 1 << 22;
  const bool one_each = frames == static_cast<double>(packed);
  if (!one_each && !append(*fragments_[0], std::min(fragments_[0]->getLength(), kMaxTable), cache_, table))
    return;
  std::uint64_t begins = 0;
  std::size_t next = 0;  // byte offset in the table
  for (std::size_t n = 1; n < fragments_.size(); ++n) {
    std::uint64_t declared = 0;
    for (std::size_t byte = 4; !one_each && next + 4 <= table.size() && byte-- > 0;)
      declared = declared << 8 | table[next + byte];
    if (one_each || (next + 4 <= table.size() && declared == begins)) {
      first_of_frame_.push_back(n);
      next += 4;
    }
    begins += std::uint64_t{8} + fragments_[n]->getLength();
  }
  first_of_frame_.push_back(fragments_.size());
  if (static_cast<double>(first_of_frame_.size() - 1) != frames || first_of_frame_.front() != 1)
    first_of_frame_.clear();
}

// Collects the compressed bytes of a frame in packed_.
bool FilePixels::fetch(const DicomFrame& frame, std::uint64_t bytes) {
  packed_.clear();
  if (std::size_t{frame.frame} + 1 >= first_of_frame_.size()) return false;
  // no compression expands a frame beyond this, so lengths cannot demand arbitrary memory
  std::uint64_t left = 2 * bytes + (1 << 16);
  for (std::size_t n = first_of_frame_[frame.frame]; n < first_of_frame_[frame.frame + 1]; ++n) {
    const Uint32 length = fragments_[n]->getLength();
    if (length > left || !append(*fragments_[n], length, cache_, packed_)) return false;
    left -= length;
  }
  return true;
}

constexpr const char* kDamagedPixels = "has damaged PixelData (7FE0,0010)";
constexpr const char* kOtherPixels = "has PixelData (7FE0,0010) that contradicts its stated size or bits";
constexpr const char* kCopyAgain = "copy the series again";

// true if the compressed image matches the attributes of the data set
bool is_as_declared(const Jpeg2000Header& packed, const DicomFrame& frame) {
  if (packed.components != 1 || packed.subsampled ||
      packed.columns != static_cast<std::uint32_t>(frame.columns) ||
      packed.rows != static_cast<std::uint32_t>(frame.rows))
    return false;
  // Either whole words or the stored bits. Old writers get the sign wrong; the data set's attribute decides.
  if (packed.bits == frame.bits_allocated) return true;
  return frame.high_bit + 1 == frame.bits_stored &&
         (packed.bits == frame.bits_stored ||
          (packed.bits < frame.bits_stored && packed.is_signed == frame.is_signed));
}

// @pre packed_ contains the frame, and buffer_ has the size of its words
Result<void> FilePixels::unpack_wavelets(const DicomFrame& frame) {
  const auto header = read_jpeg2000_header(packed_);
  if (!header) return bad_input("", kDamagedPixels, kCopyAgain);
  if (header->high_throughput)
    return bad_input("", std::string("is compressed as ") + kHighThroughput + ", which is not read",
                     kDecompress);
  if (!is_as_declared(*header, frame)) return bad_input("", kOtherPixels, kSlicer);
  // each tile takes memory, however small it is
  constexpr std::uint64_t kMaxTiles = 4096;
  if (header->tiles > kMaxTiles)
    return bad_input("", "has PixelData (7FE0,0010) in more than " + std::to_string(kMaxTiles) + " tiles",
                     kDecompress);
  if (!unpack_jpeg2000(*header, packed_, static_cast<std::size_t>(frame.bits_allocated / 8), buffer_))
    return bad_input("", kDamagedPixels, kCopyAgain);
  return {};
}

// True if a JPEG image has a TEM marker (FF01) before its frame header: DCMTK (3.6.7), searching there for
// the bit depth, would loop forever. Valid DICOM files have none.
bool has_endless_marker(std::span<const std::uint8_t> packed) {
  for (std::size_t at = 0; at + 4 < packed.size() && packed[at] == 0xFF;) {
    const std::uint8_t marker = packed[at + 1];
    if (marker == 0x01) return true;
    const bool frame = marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
    if (frame || marker == 0x00 || marker == 0x02) return false;
    const bool alone = marker < 0xC0 || (marker >= 0xD0 && marker <= 0xD9);
    at += marker == 0xFF ? 1 : alone ? 2 : 2u + packed[at + 2] * 256u + packed[at + 3];
  }
  return false;
}

// Wraps packed_ in a pixel sequence of one fragment, so that a DCMTK decoder can access nothing else. DCMTK's
// JPEG-LS decoder (3.6.7) reads one byte beyond its data, which is then part of the appended EOI marker.
bool FilePixels::isolate() {
  constexpr std::uint8_t kEndOfImage[] = {0xFF, 0xD9};
  if (packed_.size() % 2) packed_.push_back(0);
  packed_.insert(packed_.end(), std::begin(kEndOfImage), std::end(kEndOfImage));
  auto sequence = std::make_unique<DcmPixelSequence>(DcmTag(DCM_PixelSequenceTag));
  auto table = std::make_unique<DcmPixelItem>(DcmTag(DCM_PixelItemTag)),
       fragment = std::make_unique<DcmPixelItem>(DcmTag(DCM_PixelItemTag));
  if (fragment->putUint8Array(packed_.data(), static_cast<unsigned long>(packed_.size())).bad()) return false;
  for (auto* item : {&table, &fragment})
    if (sequence->insert(item->get()).good()) static_cast<void>(item->release());
  isolated_ = std::move(sequence);
  return isolated_->card() == 2;
}

// @param fill  fill value of the buffer, which remains in the last word if nothing is decoded into it
bool FilePixels::decode(const DicomFrame& frame, std::uint8_t fill, std::uint64_t bytes) {
  // padded to an even size
  buffer_.assign(static_cast<std::size_t>(bytes + bytes % 2), fill);
  DcmDataset* root = file_.getDataset();
  const auto size = static_cast<Uint32>(buffer_.size());
  const DcmXfer syntax(root->getOriginalXfer());
  OFString colours;
  Uint32 fragment = 0;
  if (!syntax.isEncapsulated())
    return pixels_->getUncompressedFrame(root, frame.frame, fragment, buffer_.data(), size, colours, &cache_)
        .good();
  // frame index of the last frame, after whose first fragment no other frame follows
  const auto frames = static_cast<Uint32>(first_of_frame_.size() - 1);
  fragment = 1;
  return DcmCodecList::decodeFrame(syntax, nullptr, isolated_.get(), root, frames - 1, fragment,
                                   buffer_.data(), size, colours)
      .good();
}

// A frame may begin at any bit; the first voxel is the least significant bit of its byte (PS3.5 8.1.1).
Result<void> FilePixels::read_bits_of(const DicomFrame& frame, std::span<std::int64_t> values) {
  const std::uint64_t first = bits_of_frame(frame) * frame.frame, last = first + values.size();
  buffer_.resize(static_cast<std::size_t>((last + 7) / 8 - first / 8));
  if (values.size() != bits_of_frame(frame) || last > std::uint64_t{pixels_->getLength()} * 8 ||
      pixels_
          ->getPartialValue(buffer_.data(), static_cast<Uint32>(first / 8),
                            static_cast<Uint32>(buffer_.size()), &cache_, EBO_LittleEndian)
          .bad())
    return bad_input("", kDamagedPixels, "copy it again");
  for (std::size_t n = 0; n < values.size(); ++n) {
    const std::uint64_t bit = first % 8 + n;
    values[n] = buffer_[static_cast<std::size_t>(bit / 8)] >> (bit % 8) & 1;
  }
  return {};
}

Result<void> FilePixels::unpack(const DicomFrame& frame, std::uint64_t bytes) {
  const Error damaged = bad_input("", kDamagedPixels, kCopyAgain);
  const E_TransferSyntax syntax = file_.getDataset()->getOriginalXfer();
  if (DcmXfer(syntax).isEncapsulated()) {
    if (!fetch(frame, bytes)) return damaged;
    buffer_.resize(static_cast<std::size_t>(bytes));
    if (is_jpeg2000(syntax)) return unpack_wavelets(frame);
    // DCMTK's own RLE decoder (3.6.7) reads beyond its input
    if (syntax == EXS_RLELossless)
      return unpack_rle(packed_, static_cast<std::size_t>(frame.bits_allocated / 8), buffer_) ? Result<void>()
                                                                                              : damaged;
    if (has_endless_marker(packed_) || !isolate()) return damaged;
  }
  // DCMTK reports no error if the compressed data are smaller than a frame, for example an 8-bit JPEG image
  // in a 16-bit data set. Decoding into two different fill values detects that.
  const auto filled = [&](std::uint8_t last) {
    const auto word =
        std::span(buffer_).first(bytes).last(static_cast<std::size_t>(frame.bits_allocated / 8));
    return std::ranges::any_of(word, [&](std::uint8_t byte) { return byte != last; });
  };
  constexpr std::uint8_t kLast[] = {0x5A, 0xA5};
  for (const std::uint8_t last : kLast) {
    if (!decode(frame, last, bytes)) return damaged;
    if (filled(last)) return {};
  }
  return bad_input("", kOtherPixels, kSlicer);
}

Result<void> FilePixels::read(const DicomFrame& frame, std::span<std::int64_t> values) {
  DcmDataset& root = *file_.getDataset();
  DicomFrame now = frame;
  Uint32 bytes = 0;
  const std::uint64_t expected = bytes_of_frame(frame);
  if (frame.bits_allocated == 1) return read_bits_of(frame, values);
  if (read_bits(root, now) || now.rows != frame.rows || now.columns != frame.columns ||
      now.bits_allocated != frame.bits_allocated ||
      values.size() * static_cast<std::size_t>(frame.bits_allocated / 8) != expected ||
      pixels_->getUncompressedFrameSize(&root, bytes).bad() || bytes != expected)
    return bad_input("", "changed while it was read", "do not change the files while they are read");

  if (auto unpacked = unpack(frame, expected); !unpacked) return unpacked;
  const std::int64_t padding = frame.padding.value_or(0);
  const std::pair<std::int64_t, std::int64_t> range =
      std::minmax({padding, frame.padding_limit.value_or(padding)});
  const auto take = [&](auto type) {
    using Word = decltype(type);
    for (std::size_t n = 0; n < values.size(); ++n) {
      Word word;
      std::memcpy(&word, buffer_.data() + n * sizeof(Word), sizeof(Word));
      values[n] = stored_value(word, frame);
      if (!frame.padding) continue;
      const std::int64_t all_bits =
          frame.is_signed ? std::int64_t{static_cast<std::make_signed_t<Word>>(word)} : std::int64_t{word};
      if (all_bits >= range.first && all_bits <= range.second) values[n] = all_bits;
    }
  };
  switch (frame.bits_allocated) {
    case 8:
      take(std::uint8_t{});
      break;
    case 16:
      take(std::uint16_t{});
      break;
    default:
      take(std::uint32_t{});
  }
  return {};
}

}  // namespace

Result<std::unique_ptr<DicomPixels>> open_file_pixels(const std::filesystem::path& name) {
  return FilePixels::open(name);
}

}  // namespace palpate::volume_io
