#include "volume_io/dicom/dicom_images.h"

#include <dcmtk/dcmdata/dcdeftag.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string_view>

#include "volume_io/dicom/dicom_jpeg2000_header.h"
#include "volume_io/dicom/dicom_readers.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

constexpr std::array<std::string_view, 14> kModalities{"CT", "MR", "PT", "NM", "US", "XA",  "CR",
                                                       "DX", "MG", "RF", "OT", "SC", "OCT", "OPT"};

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
  const auto value = number_of(item, tag);
  if (!value || std::abs(*value) > kMaxValue)
    return Fault{"has a " + in_words(tag) + " that is not a number", kExport};
  number = *value;
  return std::nullopt;
}

std::optional<Fault> read_scale(const Attributes& attributes, DicomFrame& frame) {
  if (auto wrong = read_number(attributes, DCM_RescaleSlope, frame.slope)) return wrong;
  if (auto wrong = read_number(attributes, DCM_RescaleIntercept, frame.intercept)) return wrong;
  if (frame.slope == 0)
    return Fault{"has a RescaleSlope (0028,1053) of 0: all its values are the same", kExport};
  return std::nullopt;
}

}  // namespace

bool is_jpeg2000(E_TransferSyntax syntax) {
  return syntax == EXS_JPEG2000LosslessOnly || syntax == EXS_JPEG2000;
}

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

std::int64_t stored_value(std::uint64_t word, const DicomFrame& frame) {
  const int shift = frame.high_bit + 1 - frame.bits_stored;
  const std::uint64_t mask = (std::uint64_t{1} << frame.bits_stored) - 1;
  const std::uint64_t bits = word >> shift & mask;
  const bool negative = frame.is_signed && (bits >> (frame.bits_stored - 1) & 1) != 0;
  return static_cast<std::int64_t>(bits) - (negative ? std::int64_t{1} << frame.bits_stored : 0);
}

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

std::uint64_t bits_of_frame(const DicomFrame& frame) {
  return static_cast<std::uint64_t>(frame.rows) * static_cast<std::uint64_t>(frame.columns) *
         static_cast<std::uint64_t>(frame.bits_allocated);
}
std::uint64_t bytes_of_frame(const DicomFrame& frame) {
  return (bits_of_frame(frame) + 7) / 8;
}

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

Result<DicomFile> read_images(const std::filesystem::path& name, const std::string& syntax_uid) {
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

}  // namespace palpate::volume_io
