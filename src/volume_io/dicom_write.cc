#include "volume_io/dicom_write.h"

#include <dcmtk/config/osconfig.h>

#include <dcmtk/dcmdata/dcdatset.h>
#include <dcmtk/dcmdata/dcdeftag.h>
#include <dcmtk/dcmdata/dcfilefo.h>
#include <dcmtk/dcmdata/dcitem.h>
#include <dcmtk/dcmdata/dcuid.h>
#include <dcmtk/dcmdata/dcvrul.h>

#include <sys/random.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <memory>
#include <system_error>

#include "palpate_version.h"
#include "volume_io/dicom_characters.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

constexpr const char* kNotClinical = "Not for clinical use: research and education (palpate)";

// UUIDs as PS3.5 B.2 has them, random: those that DCMTK makes tell of the machine. Empty: there is no chance.
std::string fresh_uid() {
  std::array<std::uint32_t, 4> words{};
  if (::getrandom(words.data(), sizeof words, 0) != static_cast<ssize_t>(sizeof words)) return "";
  words[1] = (words[1] & 0xFFFF0FFFu) | 0x4000u;
  words[2] = (words[2] & 0x3FFFFFFFu) | 0x80000000u;
  std::string digits;
  while (std::ranges::any_of(words, [](std::uint32_t word) { return word != 0; })) {
    std::uint64_t rest = 0;
    for (std::uint32_t& word : words) {
      const std::uint64_t value = rest << 32 | word;
      word = static_cast<std::uint32_t>(value / 10);
      rest = value % 10;
    }
    digits.insert(digits.begin(), static_cast<char>('0' + rest));
  }
  return "2.25." + digits;
}

// a number in 16 letters at most
std::string decimal(double value) {
  char text[40];
  for (int digits = 15; digits > 0; --digits) {
    std::snprintf(text, sizeof text, "%.*g", digits, value == 0 ? 0 : value);
    if (std::string(text).size() <= 16) break;
  }
  return text;
}

std::string decimals(const Eigen::Vector3d& v) {
  return decimal(v.x()) + "\\" + decimal(v.y()) + "\\" + decimal(v.z());
}

// Puts values into an item, and remembers whether all went in.
class Writer {
 public:
  explicit Writer(DcmItem& item, bool& good) : item_(item), good_(good) {}

  void text(const DcmTagKey& tag, const std::string& value) const {
    good_ = item_.putAndInsertOFStringArray(tag, OFString(value.c_str(), value.size())).good() && good_;
  }
  void fresh(const DcmTagKey& tag, const std::string& uid = fresh_uid()) const {
    good_ = !uid.empty() && good_;
    text(tag, uid);
  }
  void whole(const DcmTagKey& tag, std::uint16_t value) const {
    good_ = item_.putAndInsertUint16(tag, value).good() && good_;
  }
  void wholes(const DcmTagKey& tag, const std::vector<Uint16>& values) const {
    good_ =
        item_.putAndInsertUint16Array(tag, values.data(), static_cast<unsigned long>(values.size())).good() &&
        good_;
  }
  void longs(const DcmTagKey& tag, const std::vector<Uint32>& values) const {
    auto element = std::make_unique<DcmUnsignedLong>(DcmTag(tag));
    const bool put =
        element->putUint32Array(values.data(), static_cast<unsigned long>(values.size())).good() &&
        item_.insert(element.get(), true).good();
    if (put) static_cast<void>(element.release());
    good_ = put && good_;
  }
  void pointer(const DcmTagKey& tag, const DcmTagKey& value) const {
    good_ = item_.putAndInsertTagKey(tag, value).good() && good_;
  }
  // the next item of a sequence
  Writer in(const DcmTagKey& sequence) const {
    DcmItem* inner = nullptr;
    // -2: appended
    if (item_.findOrCreateSequenceItem(sequence, inner, -2).bad() || !inner) {
      good_ = false;
      return *this;
    }
    return Writer(*inner, good_);
  }
  void code(const DcmTagKey& sequence, const std::string& value, const std::string& scheme,
            const std::string& meaning) const {
    const Writer item = in(sequence);
    item.text(DCM_CodeValue, value);
    item.text(DCM_CodingSchemeDesignator, scheme);
    item.text(DCM_CodeMeaning, meaning);
  }
  DcmItem& item() const { return item_; }

 private:
  DcmItem& item_;
  bool& good_;
};

// of Patient and General Study what there has to be, empty where nothing is known, and what may be kept
const DcmTagKey kRequired[] = {DCM_PatientName,    DCM_PatientID, DCM_PatientBirthDate,       DCM_PatientSex,
                               DCM_StudyDate,      DCM_StudyTime, DCM_ReferringPhysicianName, DCM_StudyID,
                               DCM_AccessionNumber};
const DcmTagKey kKept[] = {DCM_IssuerOfPatientID, DCM_PatientAge, DCM_PatientSize, DCM_PatientWeight,
                           DCM_StudyDescription};

bool may_be_kept(const DcmTagKey& tag) {
  return tag == DCM_StudyInstanceUID || std::ranges::find(kRequired, tag) != std::end(kRequired) ||
         std::ranges::find(kKept, tag) != std::end(kKept);
}

void put_common(const Writer& root, const std::optional<DicomIdentity>& identity, const char* sop_class) {
  root.text(DCM_SpecificCharacterSet, "ISO_IR 192");
  root.text(DCM_SOPClassUID, sop_class);
  root.fresh(DCM_SOPInstanceUID);
  for (const DcmTagKey& tag : kRequired) root.text(tag, "");
  root.fresh(DCM_StudyInstanceUID);
  // no others, whatever the process that read them says
  if (identity)
    for (const auto& [tag, value] : identity->attributes)
      if (const DcmTagKey key(tag.first, tag.second); may_be_kept(key)) root.text(key, value);
  if (!identity) {
    root.text(DCM_PatientIdentityRemoved, "YES");
    root.text(DCM_DeidentificationMethod, "palpate: no identifier was written");
  }
  root.fresh(DCM_SeriesInstanceUID);
  root.text(DCM_SeriesNumber, "1");
  root.text(DCM_InstanceNumber, "1");
  root.text(DCM_Manufacturer, "palpate");
  root.text(DCM_ManufacturerModelName, "palpate");
  root.text(DCM_SoftwareVersions, PALPATE_VERSION);
  root.text(DCM_ImageComments, kNotClinical);
}

// today, which is no date of the patient's
void put_content_date(const Writer& root) {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  ::gmtime_r(&now, &parts);
  char date[16], time[16];
  std::strftime(date, sizeof date, "%Y%m%d", &parts);
  std::strftime(time, sizeof time, "%H%M%S", &parts);
  root.text(DCM_ContentDate, date);
  root.text(DCM_ContentTime, time);
}

// sRGB as CIELab by D65, the other way round than colour_of_segment()
std::vector<Uint16> lab_of(const std::array<std::uint8_t, 3>& colour) {
  std::array<double, 3> linear;
  for (std::size_t n = 0; n < 3; ++n) {
    const double value = colour[n] / 255.0;
    linear[n] = value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4);
  }
  const auto& [r, g, b] = linear;
  const auto root = [](double t) {
    constexpr double kDelta = 6.0 / 29;
    return t > kDelta * kDelta * kDelta ? std::cbrt(t) : t / (3 * kDelta * kDelta) + 4.0 / 29;
  };
  const double x = root((0.4124 * r + 0.3576 * g + 0.1805 * b) / 0.95047),
               y = root(0.2126 * r + 0.7152 * g + 0.0722 * b),
               z = root((0.0193 * r + 0.1192 * g + 0.9505 * b) / 1.08883);
  const auto word = [](double part) {
    return static_cast<Uint16>(std::lround(65535 * std::clamp(part, 0.0, 1.0)));
  };
  return {word((116 * y - 16) / 100), word((500 * (x - y) + 128) / 255), word((200 * (y - z) + 128) / 255)};
}

void put_segment_to_write(const Writer& root, const SegmentToWrite& segment, std::size_t number) {
  const Writer item = root.in(DCM_SegmentSequence);
  item.whole(DCM_SegmentNumber, static_cast<std::uint16_t>(number));
  item.text(DCM_SegmentLabel, segment.name);
  item.text(DCM_SegmentAlgorithmType, "SEMIAUTOMATIC");
  item.text(DCM_SegmentAlgorithmName, "palpate");
  if (segment.code.empty()) {
    item.code(DCM_SegmentedPropertyCategoryCodeSequence, "85756007", "SCT", "Tissue");
    item.code(DCM_SegmentedPropertyTypeCodeSequence, "85756007", "SCT", "Tissue");
  } else {
    item.code(DCM_SegmentedPropertyCategoryCodeSequence, "123037004", "SCT", "Anatomical Structure");
    item.code(DCM_SegmentedPropertyTypeCodeSequence, segment.code, "SCT", segment.meaning);
    DcmItem* type = nullptr;
    if (!segment.side.empty() &&
        item.item().findAndGetSequenceItem(DCM_SegmentedPropertyTypeCodeSequence, type).good() && type) {
      bool good = true;
      const bool left = segment.side == "left";
      Writer(*type, good)
          .code(DCM_SegmentedPropertyTypeModifierCodeSequence, left ? "7771000" : "24028007", "SCT",
                left ? "Left" : "Right");
    }
  }
  item.wholes(DCM_RecommendedDisplayCIELabValue, lab_of(segment.colour));
}

void put_dimensions(const Writer& root) {
  const std::string uid = fresh_uid();
  root.in(DCM_DimensionOrganizationSequence).fresh(DCM_DimensionOrganizationUID, uid);
  const std::pair<DcmTagKey, DcmTagKey> dimensions[] = {
      {DCM_ReferencedSegmentNumber, DCM_SegmentIdentificationSequence},
      {DCM_ImagePositionPatient, DCM_PlanePositionSequence}};
  for (const auto& [index, group] : dimensions) {
    const Writer dimension = root.in(DCM_DimensionIndexSequence);
    dimension.text(DCM_DimensionOrganizationUID, uid);
    dimension.pointer(DCM_DimensionIndexPointer, index);
    dimension.pointer(DCM_FunctionalGroupPointer, group);
  }
}

void put_references(const Writer& root, const DicomIdentity& identity) {
  if (identity.series.empty() || identity.images.empty()) return;
  const Writer series = root.in(DCM_ReferencedSeriesSequence);
  series.text(DCM_SeriesInstanceUID, identity.series);
  for (const auto& [sop_class, uid] : identity.images) {
    const Writer image = series.in(DCM_ReferencedInstanceSequence);
    image.text(DCM_ReferencedSOPClassUID, sop_class);
    image.text(DCM_ReferencedSOPInstanceUID, uid);
  }
}

// the images that all frames were made on
void put_sources(const Writer& shared, const DicomIdentity& identity) {
  if (identity.series.empty() || identity.images.empty()) return;
  const Writer derivation = shared.in(DCM_DerivationImageSequence);
  derivation.code(DCM_DerivationCodeSequence, "113076", "DCM", "Segmentation");
  for (const auto& [sop_class, uid] : identity.images) {
    const Writer image = derivation.in(DCM_SourceImageSequence);
    image.text(DCM_ReferencedSOPClassUID, sop_class);
    image.text(DCM_ReferencedSOPInstanceUID, uid);
    image.code(DCM_PurposeOfReferenceCodeSequence, "121322", "DCM",
               "Source image for image processing operation");
  }
}

Result<void> save(DcmFileFormat& format, bool good, const std::filesystem::path& file) {
  if (!good)
    return Error{ErrorKind::kOutput, "cannot be made into a DICOM object", file.string(),
                 "save the labels as .seg.nrrd instead, and report this"};
  const OFCondition saved = format.saveFile(file.c_str(), EXS_LittleEndianExplicit, EET_UndefinedLength);
  // where a disk is full DCMTK may leave the rest out and say nothing
  std::error_code unknown;
  const auto size = std::filesystem::file_size(file, unknown);
  const auto expected = format.calcElementLength(EXS_LittleEndianExplicit, EET_UndefinedLength);
  if (saved.good() && !unknown && static_cast<Uint32>(size) == expected) return {};
  return Error{ErrorKind::kOutput,
               std::string("cannot be written: ") + (saved.good() ? "its end is missing" : saved.text()),
               file.string(), "is the disk full, or the folder not yours to write?"};
}

std::string kept_text(DcmItem& item, const DcmTagKey& tag) {
  OFString value;
  DcmElement* element = nullptr;
  constexpr Uint32 kLongest = 1 << 12;
  if (item.findAndGetElement(tag, element).bad() || !element || element->getLengthField() > kLongest ||
      element->getOFStringArray(value).bad())
    return "";
  return {value.c_str(), value.size()};
}

// What is kept of a patient and a study, as it stands.
using Attributes = std::vector<std::pair<std::pair<std::uint16_t, std::uint16_t>, std::string>>;
Attributes kept_attributes(DcmItem& root) {
  Attributes kept;
  const auto keep = [&](const DcmTagKey& tag) {
    if (std::string value = kept_text(root, tag); !value.empty())
      kept.push_back({{tag.getGroup(), tag.getElement()}, std::move(value)});
  };
  for (const DcmTagKey& tag : kRequired) keep(tag);
  for (const DcmTagKey& tag : kKept) keep(tag);
  keep(DCM_StudyInstanceUID);
  return kept;
}

// The same in UTF-8; nothing where that cannot be had.
std::optional<Attributes> in_utf8(DcmItem& root, Attributes kept) {
  const std::string set = kept_text(root, DCM_SpecificCharacterSet);
  for (auto& [tag, value] : kept) {
    auto converted = dicom_text_in_utf8(value, set);
    if (!converted) return std::nullopt;
    value = *std::move(converted);
  }
  return kept;
}

}  // namespace

Result<DicomIdentity> read_dicom_identity(const std::filesystem::path& name) {
  DcmFileFormat file;
  constexpr Uint32 kReadAtOnce = 1 << 12;
  if (file.loadFile(name.c_str(), EXS_Unknown, EGL_noChange, kReadAtOnce, ERM_autoDetect).bad())
    return bad_input("", "is a damaged DICOM file", "copy it again");
  DcmDataset& root = *file.getDataset();
  DicomIdentity identity;
  auto attributes = in_utf8(root, kept_attributes(root));
  if (!attributes)
    return bad_input("", "has texts in a character set that cannot be converted",
                     "export without --keep-identifiers");
  identity.attributes = *std::move(attributes);
  identity.frame_of_reference = kept_text(root, DCM_FrameOfReferenceUID);
  identity.series = kept_text(root, DCM_SeriesInstanceUID);
  identity.images.emplace_back(kept_text(root, DCM_SOPClassUID), kept_text(root, DCM_SOPInstanceUID));
  return identity;
}

Result<void> write_dicom_segments(const std::filesystem::path& file, const SegmentationToWrite& seg,
                                  const std::optional<DicomIdentity>& identity) {
  DcmFileFormat format;
  bool good = true;
  const Writer root(*format.getDataset(), good);
  put_common(root, identity, UID_SegmentationStorage);
  put_content_date(root);
  root.text(DCM_Modality, "SEG");
  root.text(DCM_SeriesDescription, "Segmentation, not for clinical use");
  root.text(DCM_DeviceSerialNumber, "0");
  const bool placed = identity && !identity->frame_of_reference.empty();
  root.fresh(DCM_FrameOfReferenceUID, placed ? identity->frame_of_reference : fresh_uid());
  root.text(DCM_PositionReferenceIndicator, "");
  root.text(DCM_ImageType, "DERIVED\\PRIMARY");
  root.text(DCM_ContentLabel, "SEGMENTATION");
  root.text(DCM_ContentDescription, kNotClinical);
  root.text(DCM_ContentCreatorName, "");
  root.whole(DCM_SamplesPerPixel, 1);
  root.text(DCM_PhotometricInterpretation, "MONOCHROME2");
  root.text(DCM_NumberOfFrames, std::to_string(seg.frames.size()));
  root.whole(DCM_Rows, static_cast<std::uint16_t>(seg.rows));
  root.whole(DCM_Columns, static_cast<std::uint16_t>(seg.columns));
  root.whole(DCM_BitsAllocated, 1);
  root.whole(DCM_BitsStored, 1);
  root.whole(DCM_HighBit, 0);
  root.whole(DCM_PixelRepresentation, 0);
  root.text(DCM_LossyImageCompression, "00");
  root.text(DCM_SegmentationType, "BINARY");
  for (std::size_t n = 0; n < seg.segments.size(); ++n) put_segment_to_write(root, seg.segments[n], n + 1);
  put_dimensions(root);
  if (identity) put_references(root, *identity);

  // what all frames share, then each frame
  const Writer shared = root.in(DCM_SharedFunctionalGroupsSequence);
  const Writer measures = shared.in(DCM_PixelMeasuresSequence);
  measures.text(DCM_SliceThickness, decimal(seg.slice_spacing_mm));
  measures.text(DCM_SpacingBetweenSlices, decimal(seg.slice_spacing_mm));
  measures.text(DCM_PixelSpacing, decimal(seg.row_spacing_mm) + "\\" + decimal(seg.column_spacing_mm));
  shared.in(DCM_PlaneOrientationSequence)
      .text(DCM_ImageOrientationPatient, decimals(seg.along_row) + "\\" + decimals(seg.along_column));
  if (identity) put_sources(shared, *identity);
  const Eigen::Vector3d normal = seg.along_row.cross(seg.along_column);
  std::vector<double> places;
  for (const SegFrameToWrite& frame : seg.frames) places.push_back(frame.position.dot(normal));
  std::vector<double> sorted = places;
  std::ranges::sort(sorted);
  sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
  for (std::size_t n = 0; n < seg.frames.size(); ++n) {
    const SegFrameToWrite& frame = seg.frames[n];
    const Writer own = root.in(DCM_PerFrameFunctionalGroupsSequence);
    const auto slice = std::ranges::lower_bound(sorted, places[n]) - sorted.begin() + 1;
    own.in(DCM_FrameContentSequence)
        .longs(DCM_DimensionIndexValues, {static_cast<Uint32>(frame.segment), static_cast<Uint32>(slice)});
    own.in(DCM_PlanePositionSequence).text(DCM_ImagePositionPatient, decimals(frame.position));
    own.in(DCM_SegmentIdentificationSequence)
        .whole(DCM_ReferencedSegmentNumber, static_cast<std::uint16_t>(frame.segment));
  }
  std::vector<std::uint8_t> bits = seg.bits;
  if (bits.size() % 2) bits.push_back(0);
  good = root.item()
             .putAndInsertUint8Array(DCM_PixelData, bits.data(), static_cast<unsigned long>(bits.size()))
             .good() &&
         good;
  return save(format, good, file);
}

Result<void> write_dicom_picture(const std::filesystem::path& file, const PictureToWrite& picture,
                                 const std::optional<DicomIdentity>& identity) {
  DcmFileFormat format;
  bool good = true;
  const Writer root(*format.getDataset(), good);
  put_common(root, identity, UID_SecondaryCaptureImageStorage);
  put_content_date(root);
  root.text(DCM_Modality, "OT");
  root.text(DCM_ConversionType, "WSD");
  root.text(DCM_SeriesDescription, picture.description + ", not for clinical use");
  root.text(DCM_ImageType, "DERIVED\\SECONDARY");
  root.text(DCM_DerivationDescription, kNotClinical);
  root.text(DCM_PatientOrientation, "");
  root.text(DCM_Laterality, "");
  root.whole(DCM_SamplesPerPixel, 3);
  root.text(DCM_PhotometricInterpretation, "RGB");
  root.whole(DCM_PlanarConfiguration, 0);
  root.whole(DCM_Rows, static_cast<std::uint16_t>(picture.rows));
  root.whole(DCM_Columns, static_cast<std::uint16_t>(picture.columns));
  root.whole(DCM_BitsAllocated, 8);
  root.whole(DCM_BitsStored, 8);
  root.whole(DCM_HighBit, 7);
  root.whole(DCM_PixelRepresentation, 0);
  root.text(DCM_LossyImageCompression, "00");
  std::vector<std::uint8_t> pixels(picture.rgb.begin(), picture.rgb.end());
  if (pixels.size() % 2) pixels.push_back(0);
  good = root.item()
             .putAndInsertUint8Array(DCM_PixelData, pixels.data(), static_cast<unsigned long>(pixels.size()))
             .good() &&
         good;
  return save(format, good, file);
}

}  // namespace palpate::volume_io
