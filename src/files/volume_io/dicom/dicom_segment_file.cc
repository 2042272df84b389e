#include <dcmtk/config/osconfig.h>

#include <dcmtk/dcmdata/dcdeftag.h>

#include <algorithm>
#include <array>

#include "volume_io/dicom/dicom_images.h"
#include "volume_io/dicom/dicom_readers.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

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

}  // namespace

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

}  // namespace palpate::volume_io
