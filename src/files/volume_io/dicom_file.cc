#include "volume_io/dicom_file.h"

#include <dcmtk/config/osconfig.h>

#include <dcmtk/dcmdata/dccodec.h>
#include <dcmtk/dcmdata/dcdeftag.h>
#include <dcmtk/dcmdata/dcdict.h>
#include <dcmtk/dcmdata/dcfcache.h>
#include <dcmtk/dcmdata/dcfilefo.h>
#include <dcmtk/dcmdata/dcitem.h>
#include <dcmtk/dcmdata/dcpixel.h>
#include <dcmtk/dcmdata/dcpixseq.h>
#include <dcmtk/dcmdata/dcpxitem.h>
#include <dcmtk/dcmdata/dcsequen.h>
#include <dcmtk/dcmjpeg/djdecode.h>
#include <dcmtk/dcmjpls/djdecode.h>
#include <dcmtk/oflog/oflog.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>

#include "volume_io/dicom_characters.h"
#include "volume_io/dicom_jpeg2000.h"
#include "volume_io/dicom_rle.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

constexpr const char* kDecompress =
    "decompress it (gdcmconv --raw IN OUT), or load the series in 3D Slicer and save it as NRRD";
constexpr const char* kSlicer = "load the series in 3D Slicer and save it as NRRD";
constexpr const char* kExport = "export the series again, as CT or MR images";

// ---- element values ------------------------------------------------------------------------------

// True if an element's length is plausible for its values: DCMTK allocates whatever the length field says.
bool has_plausible_length(DcmItem& item, const DcmTagKey& tag) {
  constexpr Uint32 kMaxLength_bytes = 1 << 16;
  DcmElement* element = nullptr;
  return item.findAndGetElement(tag, element).good() && element &&
         element->getLengthField() <= kMaxLength_bytes;
}

std::optional<double> number_of(DcmItem& item, const DcmTagKey& tag, unsigned long at = 0) {
  if (!has_plausible_length(item, tag)) return std::nullopt;
  Float64 value = 0;
  if (item.findAndGetFloat64(tag, value, at).bad()) {
    // DCMTK does not convert numbers between representations (IS, FL, SL, UL, SS, US)
    Float32 single = 0;
    Sint32 whole = 0;
    Uint32 natural = 0;
    Sint16 small = 0;
    Uint16 small_natural = 0;
    if (item.findAndGetSint32(tag, whole, at).good())
      value = whole;
    else if (item.findAndGetUint32(tag, natural, at).good())
      value = natural;
    else if (item.findAndGetUint16(tag, small_natural, at).good())
      value = small_natural;
    else if (item.findAndGetSint16(tag, small, at).good())
      value = small;
    else if (item.findAndGetFloat32(tag, single, at).good())
      value = single;
    else
      return std::nullopt;
  }
  return std::isfinite(value) ? std::optional<double>(value) : std::nullopt;
}

std::optional<int> count_of(DcmItem& item, const DcmTagKey& tag) {
  Uint16 value = 0;
  if (!has_plausible_length(item, tag) || item.findAndGetUint16(tag, value).bad()) return std::nullopt;
  return value;
}

std::string text_of(DcmItem& item, const DcmTagKey& tag) {
  OFString value;
  if (!has_plausible_length(item, tag) || item.findAndGetOFStringArray(tag, value).bad()) return "";
  return std::string(value.c_str(), value.size());
}

// text converted from the file's character set to UTF-8
std::string name_text_of(DcmItem& item, const DcmTagKey& tag, const std::string& set) {
  const std::string text = text_of(item, tag);
  // Text that is invalid in its character set is returned unchanged; as invalid UTF-8 it is not accepted as a
  // name.
  return dicom_text_in_utf8(text, set).value_or(text);
}

template <std::size_t N>
std::optional<std::array<double, N>> numbers_of(DcmItem& item, const DcmTagKey& tag) {
  std::array<double, N> values{};
  for (std::size_t n = 0; n < N; ++n) {
    const auto value = number_of(item, tag, static_cast<unsigned long>(n));
    if (!value) return std::nullopt;
    values[n] = *value;
  }
  return values;
}

// "PixelSpacing (0028,0030)"
std::string in_words(const DcmTagKey& key) {
  DcmTag tag(key);
  return std::string(tag.getTagName()) + " " + key.toString().c_str();
}

// Attribute lookup of a frame: per-frame functional groups, shared functional groups, data set.
class Attributes {
 public:
  Attributes(DcmItem* own, DcmItem* shared, DcmItem& root) : items_{own, shared}, root_(root) {}

  // item that contains an attribute: the functional group or, as in single-frame files, the data set
  DcmItem& in(const DcmTagKey& group, const DcmTagKey& tag) const {
    for (DcmItem* dcm_item : items_) {
      DcmItem* item = nullptr;
      if (dcm_item && dcm_item->findAndGetSequenceItem(group, item).good() && item && item->tagExists(tag))
        return *item;
    }
    return root_;
  }
  std::optional<double> number(const DcmTagKey& group, const DcmTagKey& tag) const {
    return number_of(in(group, tag), tag);
  }

 private:
  std::array<DcmItem*, 2> items_;
  DcmItem& root_;
};

// ---- image description ----------------------------------------------------------------------------

struct Fault {
  std::string what, remedy;
};

constexpr const char* kHighThroughput = "High-Throughput JPEG 2000 (HTJ2K)";

bool is_jpeg2000(E_TransferSyntax syntax) {
  return syntax == EXS_JPEG2000LosslessOnly || syntax == EXS_JPEG2000;
}

// fault if the compression is not supported
std::optional<Fault> unsupported_syntax(E_TransferSyntax syntax, const std::string& uid) {
  const auto compressed = [](const std::string& how) {
    return Fault{"is compressed as " + how + ", which is not read", kDecompress};
  };
  if (uid == "1.2.840.10008.1.2.4.201" || uid == "1.2.840.10008.1.2.4.202" ||
      uid == "1.2.840.10008.1.2.4.203")
    return compressed(kHighThroughput);
  switch (syntax) {
    case EXS_LittleEndianImplicit:
    case EXS_LittleEndianExplicit:
    case EXS_BigEndianExplicit:
    case EXS_DeflatedLittleEndianExplicit:
    case EXS_RLELossless:
    case EXS_JPEGProcess1:
    case EXS_JPEGProcess2_4:
    case EXS_JPEGProcess14:
    case EXS_JPEGProcess14SV1:
    case EXS_JPEGLSLossless:
    case EXS_JPEGLSLossy:
    case EXS_JPEG2000LosslessOnly:
    case EXS_JPEG2000:
      return std::nullopt;
    case EXS_JPEG2000MulticomponentLosslessOnly:
    case EXS_JPEG2000Multicomponent:
      return compressed("JPEG 2000 of several components (Part 2)");
    default:
      break;
  }
  const DcmXfer known(syntax);
  if (syntax != EXS_Unknown && known.isEncapsulated()) return compressed(known.getXferName());
  return Fault{"has an unknown TransferSyntaxUID (0002,0010)", kSlicer};
}

constexpr std::array<std::string_view, 14> kModalities{"CT", "MR", "PT", "NM", "US", "XA",  "CR",
                                                       "DX", "MG", "RF", "OT", "SC", "OCT", "OPT"};

// Reads size and layout of the values, which may be single bits; returns a fault if they are not supported.
std::optional<Fault> read_bits(DcmItem& root, DicomFrame& frame) {
  const auto lacks = [](const DcmTagKey& tag) { return Fault{"lacks " + in_words(tag), kExport}; };
  const auto rows = count_of(root, DCM_Rows), columns = count_of(root, DCM_Columns),
             allocated = count_of(root, DCM_BitsAllocated);
  if (!rows || *rows == 0) return lacks(DCM_Rows);
  if (!columns || *columns == 0) return lacks(DCM_Columns);
  frame.rows = *rows;
  frame.columns = *columns;
  if (!allocated) return lacks(DCM_BitsAllocated);
  if (count_of(root, DCM_SamplesPerPixel).value_or(1) != 1)
    return Fault{"is a colour image, not a scan: SamplesPerPixel (0028,0002) is not 1", kExport};
  const std::string photometric = text_of(root, DCM_PhotometricInterpretation);
  // labels may index a palette, which defines the colours of the segments
  const bool labels = photometric == "PALETTE COLOR" && text_of(root, DCM_SegmentationType) == "LABELMAP";
  if (photometric != "MONOCHROME1" && photometric != "MONOCHROME2" && !labels)
    return Fault{
        "is not a greyscale image: PhotometricInterpretation (0028,0004) is neither MONOCHROME1 nor "
        "MONOCHROME2",
        kExport};
  frame.bits_allocated = *allocated;
  frame.bits_stored = count_of(root, DCM_BitsStored).value_or(*allocated);
  frame.high_bit = count_of(root, DCM_HighBit).value_or(frame.bits_stored - 1);
  frame.is_signed = count_of(root, DCM_PixelRepresentation).value_or(0) == 1;
  // one bit per voxel, of a segmentation
  if (*allocated == 1 && frame.bits_stored == 1 && frame.high_bit == 0) return std::nullopt;
  if ((*allocated != 8 && *allocated != 16 && *allocated != 32) || frame.bits_stored < 1 ||
      frame.high_bit >= *allocated || frame.high_bit + 1 < frame.bits_stored)
    return Fault{
        "has BitsAllocated (0028,0100), BitsStored (0028,0101) and HighBit (0028,0102) that are not "
        "supported: " +
            std::to_string(*allocated) + ", " + std::to_string(frame.bits_stored) + ", " +
            std::to_string(frame.high_bit),
        kSlicer};
  if (root.tagExists(DCM_ModalityLUTSequence))
    return Fault{"gives its values by a table, ModalityLUTSequence (0028,3000), which is not supported",
                 kSlicer};
  return std::nullopt;
}

// value of a word's stored bits, sign-extended if it is signed
std::int64_t stored_value(std::uint64_t word, const DicomFrame& frame) {
  const int shift = frame.high_bit + 1 - frame.bits_stored;
  const std::uint64_t mask = (std::uint64_t{1} << frame.bits_stored) - 1;
  const std::uint64_t bits = word >> shift & mask;
  const bool negative = frame.is_signed && (bits >> (frame.bits_stored - 1) & 1) != 0;
  return static_cast<std::int64_t>(bits) - (negative ? std::int64_t{1} << frame.bits_stored : 0);
}

// Padding value, as a word that may be written as signed or unsigned, which old files confuse. If the word
// has more bits than are stored, the padding mark uses them too.
std::optional<std::int64_t> padding_of(DcmItem& root, const DcmTagKey& tag, const DicomFrame& frame) {
  Uint16 small = 0;
  Sint16 negative = 0;
  Uint32 large = 0;
  Sint32 large_negative = 0;
  std::uint32_t word = 0;
  if (!has_plausible_length(root, tag)) return std::nullopt;
  if (root.findAndGetUint16(tag, small).good())
    word = small;
  else if (root.findAndGetSint16(tag, negative).good())
    word = static_cast<std::uint16_t>(negative);
  else if (root.findAndGetUint32(tag, large).good())
    word = large;
  else if (root.findAndGetSint32(tag, large_negative).good())
    word = static_cast<std::uint32_t>(large_negative);
  else
    return std::nullopt;
  if (!frame.is_signed) return word;
  if (frame.bits_allocated == 8) return static_cast<std::int8_t>(word);
  if (frame.bits_allocated == 16) return static_cast<std::int16_t>(word);
  return static_cast<std::int32_t>(word);
}

// reads position, orientation and spacing; returns a fault if they are missing or invalid
std::optional<Fault> read_position(const Attributes& attributes, bool several, DicomFrame& frame) {
  const auto lacks = [&](const DcmTagKey& tag) {
    return Fault{"lacks " + in_words(tag) + (several ? " for each frame" : "") +
                     ", so its orientation in the patient is unknown",
                 kExport};
  };
  const auto position = numbers_of<3>(attributes.in(DCM_PlanePositionSequence, DCM_ImagePositionPatient),
                                      DCM_ImagePositionPatient);
  if (!position) return lacks(DCM_ImagePositionPatient);
  const auto orientation = numbers_of<6>(
      attributes.in(DCM_PlaneOrientationSequence, DCM_ImageOrientationPatient), DCM_ImageOrientationPatient);
  if (!orientation) return lacks(DCM_ImageOrientationPatient);
  const auto spacing =
      numbers_of<2>(attributes.in(DCM_PixelMeasuresSequence, DCM_PixelSpacing), DCM_PixelSpacing);
  if (!spacing || !((*spacing)[0] > 0) || !((*spacing)[1] > 0)) return lacks(DCM_PixelSpacing);
  frame.position = Eigen::Vector3d(position->data());
  frame.along_row = Eigen::Vector3d(orientation->data());
  frame.along_column = Eigen::Vector3d(orientation->data() + 3);
  const double row_length = frame.along_row.norm(), column_length = frame.along_column.norm();
  constexpr double kUnit = 1e-2, kSquare = 5e-3;
  if (std::abs(row_length - 1) > kUnit || std::abs(column_length - 1) > kUnit ||
      std::abs(frame.along_row.dot(frame.along_column)) > kSquare)
    return Fault{
        "has an invalid ImageOrientationPatient (0020,0037): its directions are not orthogonal unit vectors",
        kExport};
  frame.along_row /= row_length;
  frame.along_column /= column_length;
  frame.slice_spacing_mm = attributes.number(DCM_PixelMeasuresSequence, DCM_SpacingBetweenSlices);
  frame.row_spacing_mm = (*spacing)[0];
  frame.column_spacing_mm = (*spacing)[1];
  frame.placed = frame.position.cwiseAbs().maxCoeff() < 1e6 && frame.row_spacing_mm < 1e4 &&
                 frame.column_spacing_mm < 1e4;
  if (!frame.placed)
    return Fault{"has an ImagePositionPatient (0020,0032) or a PixelSpacing (0028,0030) of kilometres",
                 kExport};
  return std::nullopt;
}

std::optional<std::array<double, 3>> gradient_of(const Attributes& attributes, DcmItem& root) {
  DcmItem& diffusion = attributes.in(DCM_MRDiffusionSequence, DCM_DiffusionGradientDirectionSequence);
  DcmItem* direction = nullptr;
  if (diffusion.findAndGetSequenceItem(DCM_DiffusionGradientDirectionSequence, direction).bad() || !direction)
    direction = &root;
  return numbers_of<3>(*direction, DCM_DiffusionGradientOrientation);
}

void read_distinguishing_values(const Attributes& attributes, DcmItem& root, DicomFrame& frame) {
  frame.echo_time_ms = attributes.number(DCM_MREchoSequence, DCM_EffectiveEchoTime);
  if (!frame.echo_time_ms) frame.echo_time_ms = number_of(root, DCM_EchoTime);
  frame.b_value = attributes.number(DCM_MRDiffusionSequence, DCM_DiffusionBValue);
  frame.gradient = gradient_of(attributes, root);
  frame.trigger_time_ms =
      attributes.number(DCM_CardiacSynchronizationSequence, DCM_NominalCardiacTriggerDelayTime);
  if (!frame.trigger_time_ms) frame.trigger_time_ms = number_of(root, DCM_TriggerTime);
  if (const auto number = number_of(root, DCM_AcquisitionNumber); number && std::abs(*number) < 1e9)
    frame.acquisition = static_cast<int>(*number);
  frame.temporal_position = attributes.number(DCM_FrameContentSequence, DCM_TemporalPositionIndex);
  if (!frame.temporal_position) frame.temporal_position = number_of(root, DCM_TemporalPositionIdentifier);
  frame.stack = text_of(attributes.in(DCM_FrameContentSequence, DCM_StackID), DCM_StackID);
  for (const DcmTagKey& group :
       {DCM_MRImageFrameTypeSequence, DCM_CTImageFrameTypeSequence, DCM_PETFrameTypeSequence}) {
    DcmItem& item = attributes.in(group, DCM_FrameType);
    if (&item != &root) frame.image_type = text_of(item, DCM_FrameType);
  }
  if (frame.image_type.empty()) frame.image_type = text_of(root, DCM_ImageType);
  // magnitude and phase of an enhanced image
  DcmItem& component = attributes.in(DCM_MRImageFrameTypeSequence, DCM_ComplexImageComponent);
  if (const std::string part = text_of(component, DCM_ComplexImageComponent); !part.empty())
    frame.image_type += "\\" + part;
  frame.frame_of_reference = text_of(root, DCM_FrameOfReferenceUID);
}

// reads a number if the attribute is present; returns a fault if it is not a number
std::optional<Fault> read_number(const Attributes& attributes, const DcmTagKey& tag, double& number) {
  DcmItem& item = attributes.in(DCM_PixelValueTransformationSequence, tag);
  if (text_of(item, tag).empty()) return std::nullopt;
  constexpr double kMaxValue = 1e30;  // leaves some margin to a float's range
  const auto declared = number_of(item, tag);
  if (!declared || std::abs(*declared) > kMaxValue)
    return Fault{"has a " + in_words(tag) + " that is not a number", kExport};
  number = *declared;
  return std::nullopt;
}

std::optional<Fault> read_scale(const Attributes& attributes, DicomFrame& frame) {
  if (auto wrong = read_number(attributes, DCM_RescaleSlope, frame.slope)) return wrong;
  if (auto wrong = read_number(attributes, DCM_RescaleIntercept, frame.intercept)) return wrong;
  if (frame.slope == 0)
    return Fault{"has a RescaleSlope (0028,1053) of 0: all its values are the same", kExport};
  return std::nullopt;
}

std::uint64_t bits_of_frame(const DicomFrame& frame) {
  return static_cast<std::uint64_t>(frame.rows) * static_cast<std::uint64_t>(frame.columns) *
         static_cast<std::uint64_t>(frame.bits_allocated);
}
std::uint64_t bytes_of_frame(const DicomFrame& frame) {
  return (bits_of_frame(frame) + 7) / 8;
}

// values longer than this are loaded on access; bytes
constexpr Uint32 kAtOnce = 4096;

// Items of a sequence in order; DCMTK's access by index counts from the first item each time.
std::vector<DcmItem*> items_of(DcmItem& root, const DcmTagKey& tag) {
  std::vector<DcmItem*> items;
  DcmSequenceOfItems* sequence = nullptr;
  if (root.findAndGetSequence(tag, sequence).bad() || !sequence) return items;
  for (DcmObject* item = sequence->nextInContainer(nullptr); item; item = sequence->nextInContainer(item))
    if (auto* plain = dynamic_cast<DcmItem*>(item)) items.push_back(plain);
  return items;
}

// Items of encapsulated pixel data: first the offset table, then the fragments.
std::vector<DcmPixelItem*> fragments_of(DcmPixelData& pixels, E_TransferSyntax syntax) {
  std::vector<DcmPixelItem*> items;
  DcmPixelSequence* sequence = nullptr;
  if (!DcmXfer(syntax).isEncapsulated() ||
      pixels.getEncapsulatedRepresentation(syntax, nullptr, sequence).bad() || !sequence)
    return items;
  for (DcmObject* item = sequence->nextInContainer(nullptr); item; item = sequence->nextInContainer(item))
    if (auto* fragment = dynamic_cast<DcmPixelItem*>(item)) items.push_back(fragment);
  return items;
}

// Appends the first `bytes` bytes of a fragment; returns false if they cannot be read.
bool append(DcmPixelItem& fragment, std::size_t bytes, DcmFileCache& cache,
            std::vector<std::uint8_t>& target) {
  const std::size_t before = target.size();
  target.resize(before + bytes);
  return bytes == 0 ||
         fragment
             .getPartialValue(target.data() + before, 0, static_cast<Uint32>(bytes), &cache, EBO_LittleEndian)
             .good();
}

// lossy compression, as far as the attributes or the first frame reveal it
bool is_lossy(DcmItem& root, E_TransferSyntax syntax) {
  if (text_of(root, DCM_LossyImageCompression) == "01") return true;
  if (syntax == EXS_JPEGProcess1 || syntax == EXS_JPEGProcess2_4 || syntax == EXS_JPEGLSLossy) return true;
  DcmElement* element = nullptr;
  if (syntax != EXS_JPEG2000 || root.findAndGetElement(DCM_PixelData, element).bad()) return false;
  auto* pixels = dynamic_cast<DcmPixelData*>(element);
  const auto fragments = pixels ? fragments_of(*pixels, syntax) : std::vector<DcmPixelItem*>();
  if (fragments.size() < 2) return false;
  constexpr Uint32 kFront = 1024;
  std::vector<std::uint8_t> front;
  DcmFileCache cache;
  if (!append(*fragments[1], std::min(fragments[1]->getLength(), kFront), cache, front)) return false;
  const auto header = read_jpeg2000_header(front);
  return header && header->irreversible;
}

// completeness of a file
enum class Loaded {
  kWhole,
  kCutShort,  ///< Its bytes end before its last element does.
  kDamaged,
};

Loaded load(DcmFileFormat& file, const std::filesystem::path& name) {
  const OFCondition loaded = file.loadFile(name.c_str(), EXS_Unknown, EGL_noChange, kAtOnce, ERM_autoDetect);
  if (loaded.good()) return Loaded::kWhole;
  // the first for a large value that ends early, the second for a small one
  if (loaded != EC_StreamNotifyClient && loaded != EC_InvalidStream && loaded != EC_EndOfStream)
    return Loaded::kDamaged;
  // Bytes of another element may follow complete pixel data. Whether the last pixel byte exists is tested by
  // a second load that leaves all values in the file.
  DcmFileFormat probe;
  constexpr Uint32 kNothing = 1;
  static_cast<void>(probe.loadFile(name.c_str(), EXS_Unknown, EGL_noChange, kNothing, ERM_autoDetect));
  DcmDataset& root = *probe.getDataset();
  DcmElement* pixels = nullptr;
  if (DcmXfer(root.getOriginalXfer()).isEncapsulated() ||
      root.findAndGetElement(DCM_PixelData, pixels).bad() || !pixels || pixels->getLengthField() == 0)
    return Loaded::kCutShort;
  Uint8 last = 0;
  DcmFileCache cache;
  const bool all_there =
      pixels->getPartialValue(&last, pixels->getLengthField() - 1, 1, &cache, EBO_LittleEndian).good();
  return all_there ? Loaded::kWhole : Loaded::kCutShort;
}

// description of an incomplete file
std::string in_words(Loaded loaded, const std::string& kind) {
  return loaded == Loaded::kCutShort ? "is a " + kind + " that ends within an element, so it was cut short"
                                     : "is a damaged " + kind;
}

// checks that the pixel data are present and complete, as far as possible without decoding
std::optional<Fault> check_pixels(DcmItem& root, const DicomFrame& frame, std::size_t frames, Loaded loaded) {
  constexpr const char* kCopy = "copy the series again";
  if (loaded == Loaded::kCutShort) return Fault{"has its PixelData (7FE0,0010) cut short", kCopy};
  if (loaded == Loaded::kDamaged) return Fault{"is damaged before its PixelData (7FE0,0010) ends", kCopy};
  if (root.tagExists(DCM_FloatPixelData) || root.tagExists(DCM_DoubleFloatPixelData))
    return Fault{
        "has its values as FloatPixelData (7FE0,0008) or DoubleFloatPixelData (7FE0,0009), which is not "
        "supported",
        kSlicer};
  DcmElement* element = nullptr;
  if (root.findAndGetElement(DCM_PixelData, element).bad() || !element)
    return Fault{"has no PixelData (7FE0,0010)", kExport};
  auto* pixels = dynamic_cast<DcmPixelData*>(element);
  if (!pixels) return Fault{"has a PixelData (7FE0,0010) without pixels", kExport};
  const auto contradicts = [&](const std::string& there, const std::string& needed) {
    return Fault{"has a PixelData (7FE0,0010) of " + there + ", but NumberOfFrames (0028,0008), Rows " +
                     "(0028,0010) and Columns (0028,0011) ask for " + needed,
                 kExport};
  };
  const E_TransferSyntax syntax = static_cast<DcmDataset&>(root).getOriginalXfer();
  // each frame has at least one fragment, and the first item is the offset table
  if (DcmXfer(syntax).isEncapsulated()) {
    const std::size_t items = fragments_of(*pixels, syntax).size();
    if (items > frames) return std::nullopt;
    return contradicts(std::to_string(items - std::min<std::size_t>(items, 1)) + " packed frames",
                       std::to_string(frames));
  }
  // single bits are packed across frames without padding
  const std::uint64_t needed = (bits_of_frame(frame) * frames + 7) / 8;
  if (element->getLength() < needed)
    return contradicts(std::to_string(element->getLength()) + " bytes", std::to_string(needed));
  return std::nullopt;
}

// ---- image files ----------------------------------------------------------------------------------

Result<DicomFile> read_whole(const std::filesystem::path& name, const std::string& syntax_uid) {
  DcmFileFormat file;
  // a file with a compression unknown to DCMTK still has a readable explicit header
  const auto unknown = syntax_uid.empty()
                           ? std::nullopt
                           : unsupported_syntax(DcmXfer(syntax_uid.c_str()).getXfer(), syntax_uid);
  const Loaded loaded = load(file, name);
  DcmDataset& root = *file.getDataset();
  // the last element of a truncated file may contain uninitialised memory
  if (loaded != Loaded::kWhole && root.card() > 0 &&
      root.getElement(root.card() - 1)->getTag() != DCM_PixelData)
    delete root.remove(root.card() - 1);
  DicomFile content;
  content.series_uid = text_of(root, DCM_SeriesInstanceUID);
  content.sop_uid = text_of(root, DCM_SOPInstanceUID);
  content.series_number =
      static_cast<int>(std::clamp(number_of(root, DCM_SeriesNumber).value_or(0), -1e9, 1e9));
  if (loaded != Loaded::kWhole && content.series_uid.empty())
    return unknown ? bad_input("", unknown->what, unknown->remedy)
                   : bad_input("", in_words(loaded, "DICOM file"), "copy it again");
  if (!root.tagExists(DCM_Rows) && loaded == Loaded::kWhole)
    return bad_input("", kNoDicomImage, "give a series of images");

  DicomFrame all;
  const std::string modality = text_of(root, DCM_Modality);
  if (std::ranges::find(kModalities, modality) != kModalities.end()) all.modality = modality;
  std::optional<Fault> fault = unknown ? unknown : unsupported_syntax(root.getOriginalXfer(), syntax_uid);
  if (auto bits = read_bits(root, all); bits && !fault) fault = bits;
  if (all.bits_allocated == 1 && !fault) fault = Fault{"has a BitsAllocated (0028,0100) of 1", kSlicer};

  const auto own = items_of(root, DCM_PerFrameFunctionalGroupsSequence),
             shared = items_of(root, DCM_SharedFunctionalGroupsSequence);
  const double declared = number_of(root, DCM_NumberOfFrames).value_or(1);
  constexpr double kMaxFrames = 100'000;
  const bool countable = declared >= 1 && declared <= kMaxFrames;
  std::size_t count = countable ? static_cast<std::size_t>(declared) : 1;
  if (!countable && !fault) fault = Fault{"has an invalid NumberOfFrames (0028,0008)", kExport};
  if (auto pixels = check_pixels(root, all, count, loaded); pixels && !fault) fault = pixels;
  // limits memory for a frame count without matching pixel data
  if (fault) count = std::min(count, std::max<std::size_t>(own.size(), 1));
  if (!fault) all.lossy = is_lossy(root, root.getOriginalXfer());
  if (!fault) all.padding = padding_of(root, DCM_PixelPaddingValue, all);
  if (all.padding) all.padding_limit = padding_of(root, DCM_PixelPaddingRangeLimit, all);

  const bool several = count > 1;
  for (std::size_t n = 0; n < count; ++n) {
    DicomFrame frame = all;
    frame.frame = static_cast<std::uint32_t>(n);
    const Attributes attributes(n < own.size() ? own[n] : nullptr, shared.empty() ? nullptr : shared.front(),
                                root);
    auto wrong = read_position(attributes, several, frame);
    // several frames need individual positions
    if (several && n >= own.size()) {
      frame.placed = false;
      wrong = Fault{"has " + std::to_string(count) + " frames without the position of each: " +
                        in_words(DCM_PerFrameFunctionalGroupsSequence),
                    kExport};
    }
    if (frame.rows == 0 || frame.columns == 0) frame.placed = false;
    read_distinguishing_values(attributes, root, frame);
    if (auto scale = read_scale(attributes, frame); scale && !wrong) wrong = scale;
    if (fault) wrong = fault;
    if (wrong) {
      frame.fault = wrong->what;
      frame.remedy = wrong->remedy;
    }
    content.frames.push_back(std::move(frame));
  }
  return content;
}

// ---- segmentations --------------------------------------------------------------------------------

struct Code {
  std::string value, scheme, meaning;
};

Code code_of(DcmItem& item, const DcmTagKey& sequence, const std::string& set) {
  DcmItem* code = nullptr;
  if (item.findAndGetSequenceItem(sequence, code).bad() || !code) return {};
  return {text_of(*code, DCM_CodeValue), text_of(*code, DCM_CodingSchemeDesignator),
          name_text_of(*code, DCM_CodeMeaning, set)};
}

// laterality, from the modifier of a type or of a region
std::string side_of(DcmItem& item, const DcmTagKey& group, const DcmTagKey& modifier) {
  DcmItem* code = nullptr;
  if (item.findAndGetSequenceItem(group, code).bad() || !code) return "";
  const std::string value = code_of(*code, modifier, "").value;
  if (value == "7771000" || value == "G-A101") return "left";
  if (value == "24028007" || value == "G-A100") return "right";
  return "";
}

// Colour of a label in the file's palette (PS3.3 C.7.6.3.1.5 and 6); nullopt if there is none.
std::optional<std::array<std::uint8_t, 3>> palette_colour(DcmItem& root, int label) {
  static const std::array<std::pair<DcmTagKey, DcmTagKey>, 3> kTables{
      {{DCM_RedPaletteColorLookupTableDescriptor, DCM_RedPaletteColorLookupTableData},
       {DCM_GreenPaletteColorLookupTableDescriptor, DCM_GreenPaletteColorLookupTableData},
       {DCM_BluePaletteColorLookupTableDescriptor, DCM_BluePaletteColorLookupTableData}}};
  std::array<std::uint8_t, 3> colour{};
  for (std::size_t c = 0; c < kTables.size(); ++c) {
    const auto descriptor = numbers_of<3>(root, kTables[c].first);
    const Uint16* words = nullptr;
    unsigned long count = 0;
    constexpr Uint32 kMaxLength_bytes = 1 << 18;
    DcmElement* element = nullptr;
    if (!descriptor || root.findAndGetElement(kTables[c].second, element).bad() || !element ||
        element->getLengthField() > kMaxLength_bytes ||
        root.findAndGetUint16Array(kTables[c].second, words, &count).bad() || !words)
      return std::nullopt;
    // 8-bit entries are packed two to a word, the first in the low byte
    const double entry = label - (*descriptor)[1];
    const bool bytes = (*descriptor)[2] == 8;
    if (entry < 0 || entry >= static_cast<double>(count) * (bytes ? 2 : 1)) return std::nullopt;
    const auto at = static_cast<std::size_t>(entry);
    colour[c] = static_cast<std::uint8_t>(bytes ? words[at / 2] >> (at % 2 * 8) : words[at] >> 8);
  }
  return colour;
}

DicomSegment segment_of(DcmItem& item, const std::string& set) {
  DicomSegment segment;
  segment.number = count_of(item, DCM_SegmentNumber).value_or(0);
  segment.label = name_text_of(item, DCM_SegmentLabel, set);
  const Code type = code_of(item, DCM_SegmentedPropertyTypeCodeSequence, set);
  segment.code = type.value;
  segment.scheme = type.scheme;
  segment.meaning = type.meaning;
  segment.side =
      side_of(item, DCM_SegmentedPropertyTypeCodeSequence, DCM_SegmentedPropertyTypeModifierCodeSequence);
  if (segment.side.empty())
    segment.side = side_of(item, DCM_AnatomicRegionSequence, DCM_AnatomicRegionModifierSequence);
  if (const auto lab = numbers_of<3>(item, DCM_RecommendedDisplayCIELabValue)) {
    segment.lab.emplace();
    for (std::size_t c = 0; c < 3; ++c)
      (*segment.lab)[c] = static_cast<std::uint16_t>(std::clamp((*lab)[c], 0.0, 65535.0));
  }
  return segment;
}

Result<DicomSegmentation> read_segments(const std::filesystem::path& name, const std::string& syntax_uid) {
  DcmFileFormat file;
  const Loaded loaded = load(file, name);
  DcmDataset& root = *file.getDataset();
  const auto refused = [](const Fault& fault) { return bad_input("", fault.what, fault.remedy); };
  if (loaded != Loaded::kWhole) return bad_input("", in_words(loaded, "DICOM segmentation"), "copy it again");
  DicomSegmentation segmentation;
  DicomFrame all;
  if (auto fault = unsupported_syntax(root.getOriginalXfer(), syntax_uid)) return refused(*fault);
  if (auto fault = read_bits(root, all)) return refused(*fault);
  using Kind = SegmentCoding::Kind;
  SegmentCoding& coding = segmentation.codings.emplace_back();
  const std::string type = text_of(root, DCM_SegmentationType);
  coding.kind = type == "BINARY" ? Kind::kBinary : type == "FRACTIONAL" ? Kind::kFractional : Kind::kLabels;
  const bool known = type == "BINARY" || type == "FRACTIONAL" || type == "LABELMAP";
  const bool fits = (coding.kind == Kind::kBinary) == (all.bits_allocated == 1) && all.bits_allocated <= 16 &&
                    !all.is_signed;
  if (!known || !fits)
    return refused(
        {"has a SegmentationType (0062,0001) and a BitsAllocated (0028,0100) that are not read", kSlicer});
  if (all.bits_allocated == 1 && DcmXfer(root.getOriginalXfer()).isEncapsulated())
    return refused({"has packed bits, which are not supported", kDecompress});
  if (coding.kind == Kind::kLabels && is_lossy(root, root.getOriginalXfer()))
    return refused({"has labels that are compressed with loss, so they may be wrong", kSlicer});
  coding.max_fractional_value = count_of(root, DCM_MaximumFractionalValue).value_or(255);
  if (coding.kind == Kind::kLabels) coding.background_value = padding_of(root, DCM_PixelPaddingValue, all);
  segmentation.series_uid = text_of(root, DCM_SeriesInstanceUID);
  segmentation.concatenation_uid = text_of(root, DCM_ConcatenationUID);

  const auto own = items_of(root, DCM_PerFrameFunctionalGroupsSequence),
             shared = items_of(root, DCM_SharedFunctionalGroupsSequence);
  // the frame count must match the items, so that it cannot demand memory by itself
  const double declared = number_of(root, DCM_NumberOfFrames).value_or(0);
  if (declared < 1 || declared != static_cast<double>(own.size()))
    return refused({"has " + std::to_string(own.size()) +
                        " items of PerFrameFunctionalGroupsSequence (5200,9230) but a different "
                        "NumberOfFrames (0028,0008)",
                    kExport});
  if (auto fault = check_pixels(root, all, own.size(), loaded)) return refused(*fault);
  for (DcmItem* item : items_of(root, DCM_SegmentSequence)) {
    segmentation.segments.push_back(segment_of(*item, text_of(root, DCM_SpecificCharacterSet)));
    DicomSegment& segment = segmentation.segments.back();
    if (!segment.lab) segment.rgb = palette_colour(root, segment.number);
  }
  for (std::size_t n = 0; n < own.size(); ++n) {
    DicomFrame frame = all;
    frame.frame = static_cast<std::uint32_t>(n);
    const Attributes attributes(own[n], shared.empty() ? nullptr : shared.front(), root);
    if (auto wrong = read_position(attributes, true, frame)) {
      frame.fault = wrong->what;
      frame.remedy = wrong->remedy;
    }
    if (n == 0) {
      segmentation.slice_spacing_mm = attributes.number(DCM_PixelMeasuresSequence, DCM_SpacingBetweenSlices);
      if (!segmentation.slice_spacing_mm)
        segmentation.slice_spacing_mm = attributes.number(DCM_PixelMeasuresSequence, DCM_SliceThickness);
    }
    const DcmTagKey number = DCM_ReferencedSegmentNumber;
    segmentation.segment_of_frame.push_back(
        coding.kind == Kind::kLabels
            ? 0
            : count_of(attributes.in(DCM_SegmentIdentificationSequence, number), number).value_or(0));
    segmentation.frames.push_back(std::move(frame));
  }
  return segmentation;
}

// ---- structure sets -------------------------------------------------------------------------------

constexpr const char* kDamagedStructures = "is a damaged DICOM structure set";

// Numbers of a long text, separated by backslashes; nullopt if one is invalid or exceeds 1e6 mm.
std::optional<std::vector<double>> long_numbers_of(DcmItem& item, const DcmTagKey& tag) {
  constexpr Uint32 kMaxText_bytes = 1 << 26;
  DcmElement* element = nullptr;
  char* text = nullptr;
  Uint32 length = 0;
  if (item.findAndGetElement(tag, element).bad() || !element || element->getLengthField() > kMaxText_bytes ||
      element->getString(text, length).bad())
    return std::nullopt;
  std::vector<double> numbers;
  const char *at = text, *end = text ? text + length : text;
  while (at != end) {
    const char* next = std::find(at, end, '\\');
    const auto is_blank = [](char c) { return c == ' ' || c == '\0' || c == '+'; };
    while (at != next && is_blank(*at)) ++at;
    double number = 0;
    const auto [last, failed] = std::from_chars(at, next, number);
    constexpr double kMax_mm = 1e6;
    if (failed != std::errc() || !std::all_of(last, next, is_blank) || !(std::abs(number) < kMax_mm))
      return std::nullopt;
    numbers.push_back(number);
    at = next == end ? end : next + 1;
  }
  return numbers;
}

// points of a contour, without a repetition of the first at the end; nullopt if they are invalid
std::optional<std::vector<Eigen::Vector3d>> points_of(DcmItem& contour) {
  const auto numbers = long_numbers_of(contour, DCM_ContourData);
  const auto declared = number_of(contour, DCM_NumberOfContourPoints);
  if (!numbers || numbers->size() % 3 != 0 ||
      (declared && *declared != static_cast<double>(numbers->size() / 3)))
    return std::nullopt;
  std::vector<Eigen::Vector3d> points;
  for (std::size_t n = 0; n < numbers->size(); n += 3) points.emplace_back(numbers->data() + n);
  while (points.size() > 1 && points.back() == points.front()) points.pop_back();
  return points;
}

// Adds the closed contours of an item of ROIContourSequence; returns false if the data are damaged.
bool add_contours(DcmItem& item, std::size_t& points_left, DicomStructure& structure) {
  if (const auto colour = numbers_of<3>(item, DCM_ROIDisplayColor)) {
    structure.colour.emplace();
    for (std::size_t c = 0; c < 3; ++c)
      (*structure.colour)[c] = static_cast<std::uint8_t>(std::clamp((*colour)[c], 0.0, 255.0));
  }
  for (DcmItem* contour : items_of(item, DCM_ContourSequence)) {
    const std::string type = text_of(*contour, DCM_ContourGeometricType);
    if (type != "CLOSED_PLANAR" && type != "CLOSEDPLANAR_XOR") {
      ++structure.left_out;
      continue;
    }
    auto points = points_of(*contour);
    if (!points || points->size() > points_left) return false;
    points_left -= points->size();
    if (points->size() < 3)
      ++structure.left_out;
    else
      structure.contours.push_back(*std::move(points));
  }
  return true;
}

Result<std::vector<DicomStructure>> read_structure_set(const std::filesystem::path& name) {
  const auto damaged = [] { return bad_input("", kDamagedStructures, "copy it again"); };
  DcmFileFormat file;
  if (const Loaded loaded = load(file, name); loaded != Loaded::kWhole)
    return bad_input("", in_words(loaded, "DICOM structure set"), "copy it again");
  DcmDataset& root = *file.getDataset();
  const std::string set = text_of(root, DCM_SpecificCharacterSet);
  std::vector<DicomStructure> structures;
  std::map<double, std::size_t> index_of_number;
  for (DcmItem* item : items_of(root, DCM_StructureSetROISequence)) {
    const auto number = number_of(*item, DCM_ROINumber);
    if (!number || !index_of_number.emplace(*number, structures.size()).second)
      return bad_input("", "has a structure without an ROINumber (3006,0022), or a repeated one",
                       "export it again");
    DicomStructure& structure = structures.emplace_back();
    structure.segment.number = static_cast<int>(structures.size());
    structure.segment.label = name_text_of(*item, DCM_ROIName, set);
  }
  const auto referenced = [&](DcmItem& item) -> DicomStructure* {
    const auto number = number_of(item, DCM_ReferencedROINumber);
    const auto found = number ? index_of_number.find(*number) : index_of_number.end();
    return found == index_of_number.end() ? nullptr : &structures[found->second];
  };
  for (DcmItem* item : items_of(root, DCM_RTROIObservationsSequence))
    if (DicomStructure* structure = referenced(*item)) {
      const Code code = code_of(*item, DCM_RTROIIdentificationCodeSequence, set);
      structure->segment.code = code.value;
      structure->segment.scheme = code.scheme;
      structure->segment.meaning = code.meaning;
    }
  // the outline of a body in 1000 slices has some hundred thousand points
  std::size_t points_left = 10'000'000;
  for (DcmItem* item : items_of(root, DCM_ROIContourSequence)) {
    DicomStructure* structure = referenced(*item);
    if (!structure || !add_contours(*item, points_left, *structure)) return damaged();
  }
  if (std::ranges::all_of(structures, [](const DicomStructure& each) { return each.contours.empty(); }))
    return bad_input("", "holds no closed contour (ContourSequence (3006,0040))",
                     "export its structures again");
  return structures;
}

// ---- referenced images ----------------------------------------------------------------------------

// calls visit(item) for each item of a sequence
template <class Visit>
void for_each_item(DcmItem& item, const DcmTagKey& sequence, const Visit& visit) {
  for (DcmItem* each : items_of(item, sequence)) visit(*each);
}

Result<DicomReference> read_references(const std::filesystem::path& name) {
  DcmFileFormat file;
  if (const Loaded loaded = load(file, name); loaded != Loaded::kWhole)
    return bad_input("", in_words(loaded, "DICOM file"), "copy it again");
  DcmDataset& root = *file.getDataset();
  DicomReference reference;
  const auto put = [](DcmItem& item, const DcmTagKey& tag, std::set<std::string>& uids) {
    if (std::string uid = text_of(item, tag); !uid.empty()) uids.insert(std::move(uid));
  };
  const auto put_images = [&](DcmItem& item, const DcmTagKey& sequence) {
    for_each_item(item, sequence,
                  [&](DcmItem& image) { put(image, DCM_ReferencedSOPInstanceUID, reference.images); });
  };
  reference.own_series = text_of(root, DCM_SeriesInstanceUID);
  put(root, DCM_FrameOfReferenceUID, reference.frames_of_reference);
  // references of a segmentation
  for_each_item(root, DCM_ReferencedSeriesSequence, [&](DcmItem& series) {
    put(series, DCM_SeriesInstanceUID, reference.series);
    put_images(series, DCM_ReferencedInstanceSequence);
  });
  put_images(root, DCM_SourceImageSequence);
  const auto put_sources = [&](DcmItem& group) {
    for_each_item(group, DCM_DerivationImageSequence,
                  [&](DcmItem& derivation) { put_images(derivation, DCM_SourceImageSequence); });
  };
  for_each_item(root, DCM_SharedFunctionalGroupsSequence, put_sources);
  for_each_item(root, DCM_PerFrameFunctionalGroupsSequence, put_sources);
  // references of a structure set
  for_each_item(root, DCM_ReferencedFrameOfReferenceSequence, [&](DcmItem& space) {
    put(space, DCM_FrameOfReferenceUID, reference.frames_of_reference);
    for_each_item(space, DCM_RTReferencedStudySequence, [&](DcmItem& study) {
      for_each_item(study, DCM_RTReferencedSeriesSequence, [&](DcmItem& series) {
        put(series, DCM_SeriesInstanceUID, reference.series);
        put_images(series, DCM_ContourImageSequence);
      });
    });
  });
  return reference;
}

// ---- pixels ---------------------------------------------------------------------------------------

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

class DcmtkFiles : public DicomLibrary {
 public:
  Result<void> load_dictionary() override {
    if (dcmDataDict.isDictionaryLoaded()) return {};
    return Error{ErrorKind::kUnavailable, "DCMTK's dictionary of DICOM's tags cannot be read", "",
                 "install the package of DCMTK again (libdcmtk17)"};
  }
  void begin_reading() override {
    OFLog::configure(OFLogger::OFF_LOG_LEVEL);
    DJDecoderRegistration::registerCodecs();
    DJLSDecoderRegistration::registerCodecs();
  }
  Result<DicomFile> read_file(const std::filesystem::path& name, const std::string& syntax_uid) override try {
    return read_whole(name, syntax_uid);
  } catch (const std::exception&) {
    // std::bad_alloc for a length in the file; any other exception terminates the process
    return bad_input("", "is a damaged DICOM file", "copy it again");
  }
  Result<DicomSegmentation> read_segmentation(const std::filesystem::path& name,
                                              const std::string& syntax_uid) override try {
    return read_segments(name, syntax_uid);
  } catch (const std::exception&) {
    return bad_input("", "is a damaged DICOM segmentation", "copy it again");
  }
  Result<std::vector<DicomStructure>> read_structures(const std::filesystem::path& name) override try {
    return read_structure_set(name);
  } catch (const std::exception&) {
    return bad_input("", kDamagedStructures, "copy it again");
  }
  Result<DicomReference> read_reference(const std::filesystem::path& name) override try {
    return read_references(name);
  } catch (const std::exception&) {
    return bad_input("", "is a damaged DICOM file", "copy it again");
  }
  Result<std::vector<DicomIdentifier>> read_identifiers(const std::filesystem::path& name) override try {
    return identifiers_of_dicom(name);
  } catch (const std::exception&) {
    return bad_input("", "is a damaged DICOM file", "copy it again");
  }
  Result<std::vector<std::vector<std::string>>> read_directory(const std::filesystem::path& name) override
      try {
    return files_of_dicomdir(name);
  } catch (const std::exception&) {
    return bad_input("", "is a damaged DICOMDIR", "copy it again");
  }
  Result<DicomIdentity> read_identity(const std::filesystem::path& name) override try {
    return read_dicom_identity(name);
  } catch (const std::exception&) {
    return bad_input("", "is a damaged DICOM file", "copy it again");
  }
  Result<void> write_segmentation(const std::filesystem::path& file, const SegmentationToWrite& segmentation,
                                  const std::optional<DicomIdentity>& identity) override {
    OFLog::configure(OFLogger::OFF_LOG_LEVEL);
    return write_dicom_segments(file, segmentation, identity);
  }
  Result<void> write_picture(const std::filesystem::path& file, const PictureToWrite& picture,
                             const std::optional<DicomIdentity>& identity) override {
    OFLog::configure(OFLogger::OFF_LOG_LEVEL);
    return write_dicom_picture(file, picture, identity);
  }
  Result<std::unique_ptr<DicomPixels>> open_pixels(const std::filesystem::path& name) override {
    return FilePixels::open(name);
  }
};

}  // namespace
}  // namespace palpate::volume_io

palpate::volume_io::DicomLibrary* palpate_dicom_files() {
  static palpate::volume_io::DcmtkFiles files;
  return &files;
}
