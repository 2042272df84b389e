#include "volume_io/dicom/test_dicom.h"

#include <dcmtk/config/osconfig.h>

#include <dcmtk/dcmdata/dcdeftag.h>
#include <dcmtk/dcmdata/dcfilefo.h>
#include <dcmtk/dcmdata/dcitem.h>
#include <dcmtk/dcmdata/dcmetinf.h>
#include <dcmtk/dcmdata/dcpixel.h>
#include <dcmtk/dcmdata/dcpixseq.h>
#include <dcmtk/dcmdata/dcpxitem.h>
#include <dcmtk/dcmdata/dcrleerg.h>
#include <dcmtk/dcmdata/dcuid.h>
#include <dcmtk/dcmjpeg/djencode.h>
#include <dcmtk/dcmjpeg/djrplol.h>
#include <dcmtk/dcmjpeg/djrploss.h>
#include <dcmtk/dcmjpls/djencode.h>
#include <dcmtk/dcmjpls/djrparam.h>
#include <dcmtk/oflog/oflog.h>

#include <cstdio>
#include <memory>

#include "palpate/base/check.h"
#include "volume_io/dicom/test_jpeg2000.h"

namespace palpate::test {
namespace {

template <class Numbers>
std::string in_text(const Numbers& numbers) {
  std::string text;
  for (const double number : numbers) {
    char one[32];
    std::snprintf(one, sizeof one, "%.10g", number);
    text += (text.empty() ? "" : "\\") + std::string(one);
  }
  return text;
}

void put(DcmItem& item, const DcmTagKey& tag, const std::string& text) {
  PALPATE_CHECK(item.putAndInsertString(tag, text.c_str()).good());
}
void put(DcmItem& item, const DcmTagKey& tag, int number) {
  PALPATE_CHECK(item.putAndInsertUint16(tag, static_cast<Uint16>(number)).good());
}
void put(DcmItem& item, const DcmTagKey& tag, const std::optional<double>& number) {
  if (number) put(item, tag, in_text(std::array{*number}));
}

DcmItem& item_of(DcmItem& parent, const DcmTagKey& sequence, long n = 0) {
  DcmItem* item = nullptr;
  PALPATE_CHECK(parent.findOrCreateSequenceItem(sequence, item, n).good());
  return *item;
}

void put_scale(DcmItem& item, const DicomImage::Frame& frame) {
  put(item, DCM_RescaleSlope, frame.slope);
  put(item, DCM_RescaleIntercept, frame.intercept);
}

void put_positions(DcmDataset& root, const DicomImage& image) {
  if (!image.multi_frame) {
    put(root, DCM_ImagePositionPatient, in_text(image.frames[0].position));
    put(root, DCM_ImageOrientationPatient, in_text(image.orientation));
    if (image.spacing_mm) put(root, DCM_PixelSpacing, in_text(*image.spacing_mm));
    put_scale(root, image.frames[0]);
    return;
  }
  put(root, DCM_NumberOfFrames, std::to_string(image.frames.size()));
  DcmItem& shared = item_of(root, DCM_SharedFunctionalGroupsSequence);
  put(item_of(shared, DCM_PlaneOrientationSequence), DCM_ImageOrientationPatient, in_text(image.orientation));
  if (image.spacing_mm)
    put(item_of(shared, DCM_PixelMeasuresSequence), DCM_PixelSpacing, in_text(*image.spacing_mm));
  for (std::size_t n = 0; n < image.frames.size(); ++n) {
    DcmItem& own = item_of(root, DCM_PerFrameFunctionalGroupsSequence, static_cast<long>(n));
    put(item_of(own, DCM_PlanePositionSequence), DCM_ImagePositionPatient, in_text(image.frames[n].position));
    if (image.frames[n].trigger_time_ms)
      PALPATE_CHECK(
          item_of(own, DCM_CardiacSynchronizationSequence)
              .putAndInsertFloat64(DCM_NominalCardiacTriggerDelayTime, *image.frames[n].trigger_time_ms)
              .good());
    if (image.frames[n].temporal_position)
      PALPATE_CHECK(item_of(own, DCM_FrameContentSequence)
                        .putAndInsertUint32(DCM_TemporalPositionIndex, *image.frames[n].temporal_position)
                        .good());
    if (image.frames[n].slope) put_scale(item_of(own, DCM_PixelValueTransformationSequence), image.frames[n]);
  }
}

void put_patient(DcmDataset& root, const std::string& patient) {
  for (const DcmTagKey& tag :
       {DCM_PatientName, DCM_PatientID, DCM_StudyDescription, DCM_SeriesDescription, DCM_ImageComments,
        DCM_ProtocolName, DCM_AccessionNumber, DCM_StudyID, DCM_InstitutionName})
    put(root, tag, patient.substr(0, 16));
  PALPATE_CHECK(root.putAndInsertString(DcmTag(0x0029, 0x0010, EVR_LO), "PALPATE TEST").good());
  PALPATE_CHECK(root.putAndInsertString(DcmTag(0x0029, 0x1001, EVR_LO), patient.c_str()).good());
}

void put_pixels(DcmDataset& root, const DicomImage& image) {
  std::vector<Uint16> words;
  std::vector<Uint8> bytes;
  for (const auto& frame : image.frames)
    for (const std::uint16_t word : frame.stored)
      for (int sample = 0; sample < image.samples; ++sample) {
        words.push_back(word);
        bytes.push_back(static_cast<Uint8>(word));
      }
  if (image.bits_allocated == 8) {
    if (bytes.size() % 2) bytes.push_back(0);
    PALPATE_CHECK(root.putAndInsertUint8Array(DCM_PixelData, bytes.data(), bytes.size()).good());
  } else {
    PALPATE_CHECK(root.putAndInsertUint16Array(DCM_PixelData, words.data(), words.size()).good());
  }
}

E_TransferSyntax syntax_of(DicomPacking packing) {
  switch (packing) {
    case DicomPacking::kImplicit:
      return EXS_LittleEndianImplicit;
    case DicomPacking::kBigEndian:
      return EXS_BigEndianExplicit;
    case DicomPacking::kDeflated:
      return EXS_DeflatedLittleEndianExplicit;
    case DicomPacking::kRle:
      return EXS_RLELossless;
    case DicomPacking::kJpegBaseline:
      return EXS_JPEGProcess1;
    case DicomPacking::kJpegExtended:
      return EXS_JPEGProcess2_4;
    case DicomPacking::kJpegLossless:
      return EXS_JPEGProcess14;
    case DicomPacking::kJpegLosslessFirstOrder:
      return EXS_JPEGProcess14SV1;
    case DicomPacking::kJpegLs:
      return EXS_JPEGLSLossless;
    case DicomPacking::kJpegLsNear:
      return EXS_JPEGLSLossy;
    case DicomPacking::kJpeg2000Lossless:
      return EXS_JPEG2000LosslessOnly;
    case DicomPacking::kJpeg2000:
    case DicomPacking::kJpeg2000Lossy:
      return EXS_JPEG2000;
    case DicomPacking::kExplicit:
      break;
  }
  return EXS_LittleEndianExplicit;
}

bool is_jpeg2000(DicomPacking packing) {
  return packing == DicomPacking::kJpeg2000Lossless || packing == DicomPacking::kJpeg2000 ||
         packing == DicomPacking::kJpeg2000Lossy;
}

// codestream of a frame, padded to an even length
std::vector<std::uint8_t> codestream_of(const DicomImage& image, const DicomImage::Frame& frame,
                                        DicomPacking packing) {
  Jpeg2000Coding coding;
  coding.bits = image.packed_bits.value_or(image.bits_stored);
  coding.is_signed = image.packed_sign.value_or(image.is_signed);
  coding.irreversible = packing == DicomPacking::kJpeg2000Lossy;
  std::vector<std::int32_t> values;
  for (const std::uint16_t word : frame.stored) {
    const std::int32_t value = word & ((1 << coding.bits) - 1);
    const bool negative = coding.is_signed && value >> (coding.bits - 1) != 0;
    values.push_back(negative ? value - (1 << coding.bits) : value);
  }
  auto stream = pack_jpeg2000(image.rows, image.columns, values, coding);
  if (stream.size() % 2) stream.push_back(0);
  return stream;
}

// DCMTK has no JPEG 2000 encoder
void put_jpeg2000(DcmDataset& root, const DicomImage& image, DicomPacking packing) {
  auto sequence = std::make_unique<DcmPixelSequence>(DcmTag(DCM_PixelSequenceTag));
  const auto append = [&](const std::uint8_t* bytes, std::size_t count) {
    auto item = std::make_unique<DcmPixelItem>(DcmTag(DCM_PixelItemTag));
    if (count > 0) PALPATE_CHECK(item->putUint8Array(bytes, static_cast<unsigned long>(count)).good());
    PALPATE_CHECK(sequence->insert(item.get()).good());
    return item.release();
  };
  DcmPixelItem* table = append(nullptr, 0);
  DcmOffsetList sizes;
  for (const DicomImage::Frame& frame : image.frames) {
    const auto stream = codestream_of(image, frame, packing);
    std::size_t size = 0;
    for (std::size_t piece = 0; piece < image.pieces; ++piece) {
      const std::size_t each = stream.size() / image.pieces / 2 * 2, first = piece * each,
                        count = piece + 1 == image.pieces ? stream.size() - first : each;
      append(stream.data() + first, count);
      size += 8 + count;
    }
    sizes.push_back(static_cast<Uint32>(size));
  }
  if (image.pieces > 1) PALPATE_CHECK(table->createOffsetTable(sizes).good());
  auto pixels = std::make_unique<DcmPixelData>(DcmTag(DCM_PixelData));
  pixels->putOriginalRepresentation(syntax_of(packing), nullptr, sequence.release());
  PALPATE_CHECK(root.insert(pixels.release(), OFTrue).good());
}

// registered for the lifetime of the program
class Encoders {
 public:
  Encoders() {
    OFLog::configure(OFLogger::OFF_LOG_LEVEL);
    DcmRLEEncoderRegistration::registerCodecs();
    DJEncoderRegistration::registerCodecs();
    DJLSEncoderRegistration::registerCodecs();
  }
  ~Encoders() {
    DcmRLEEncoderRegistration::cleanup();
    DJEncoderRegistration::cleanup();
    DJLSEncoderRegistration::cleanup();
  }
  Encoders(const Encoders&) = delete;
  Encoders& operator=(const Encoders&) = delete;
};

void need_encoders() {
  static const Encoders encoders;
}

// 8 bits per entry, two to a word
void put_palette(DcmDataset& root, const std::vector<std::array<std::uint8_t, 3>>& palette) {
  const std::array<std::pair<DcmTagKey, DcmTagKey>, 3> tables{
      {{DCM_RedPaletteColorLookupTableDescriptor, DCM_RedPaletteColorLookupTableData},
       {DCM_GreenPaletteColorLookupTableDescriptor, DCM_GreenPaletteColorLookupTableData},
       {DCM_BluePaletteColorLookupTableDescriptor, DCM_BluePaletteColorLookupTableData}}};
  for (std::size_t c = 0; c < 3; ++c) {
    const Uint16 descriptor[] = {static_cast<Uint16>(palette.size()), 0, 8};
    std::vector<Uint16> words((palette.size() + 1) / 2);
    for (std::size_t n = 0; n < palette.size(); ++n)
      words[n / 2] = static_cast<Uint16>(words[n / 2] | palette[n][c] << (n % 2 * 8));
    PALPATE_CHECK(root.putAndInsertUint16Array(DcmTag(tables[c].first, EVR_US), descriptor, 3).good());
    PALPATE_CHECK(
        root.putAndInsertUint16Array(DcmTag(tables[c].second, EVR_OW), words.data(), words.size()).good());
  }
}

}  // namespace

void write_dicom(const std::filesystem::path& file, const DicomImage& image, DicomPacking packing,
                 bool preamble) {
  need_encoders();
  DcmFileFormat format;
  DcmDataset& root = *format.getDataset();
  char uid[100];
  put(root, DCM_SOPClassUID,
      image.multi_frame ? UID_EnhancedCTImageStorage
                        : (image.modality == "MR" ? UID_MRImageStorage : UID_CTImageStorage));
  put(root, DCM_SOPInstanceUID,
      image.sop_instance.empty() ? std::string(dcmGenerateUniqueIdentifier(uid)) : image.sop_instance);
  put(root, DCM_SeriesInstanceUID, image.series);
  put(root, DCM_Modality, image.modality);
  put(root, DCM_ImageType, image.image_type);
  if (image.instance_number) put(root, DCM_InstanceNumber, std::to_string(*image.instance_number));
  if (!image.patient.empty()) put_patient(root, image.patient);
  put(root, DCM_EchoTime, image.echo_time_ms);
  put(root, DCM_TriggerTime, image.trigger_time_ms);
  if (image.acquisition) put(root, DCM_AcquisitionNumber, std::to_string(*image.acquisition));
  if (image.gradient)
    PALPATE_CHECK(
        root.putAndInsertFloat64Array(DCM_DiffusionGradientOrientation, image.gradient->data(), 3).good());
  if (image.b_value) PALPATE_CHECK(root.putAndInsertFloat64(DCM_DiffusionBValue, *image.b_value).good());
  put(root, DCM_Rows, image.rows);
  put(root, DCM_Columns, image.columns);
  put(root, DCM_SamplesPerPixel, image.samples);
  if (image.samples > 1) put(root, DCM_PlanarConfiguration, 0);
  put(root, DCM_PhotometricInterpretation, image.photometric);
  put(root, DCM_BitsAllocated, image.bits_allocated);
  put(root, DCM_BitsStored, image.bits_stored);
  put(root, DCM_HighBit, image.high_bit);
  put(root, DCM_PixelRepresentation, image.is_signed ? 1 : 0);
  if (image.padding) {
    const DcmTag tag(DCM_PixelPaddingValue, image.is_signed ? EVR_SS : EVR_US);
    PALPATE_CHECK((image.is_signed ? root.putAndInsertSint16(tag, static_cast<Sint16>(*image.padding))
                                   : root.putAndInsertUint16(tag, static_cast<Uint16>(*image.padding)))
                      .good());
  }
  put_positions(root, image);
  for (const DicomText& text : image.texts) put(root, DcmTagKey(text.group, text.element), text.text);
  is_jpeg2000(packing) ? put_jpeg2000(root, image, packing) : put_pixels(root, image);

  const DJ_RPLossless lossless(packing == DicomPacking::kJpegLossless ? 6 : 1);
  const DJ_RPLossy lossy(100);
  const DJLSRepresentationParameter lossless_ls, near_ls(2, OFFalse);
  const DcmRepresentationParameter* parameter = nullptr;
  if (packing == DicomPacking::kJpegBaseline || packing == DicomPacking::kJpegExtended) parameter = &lossy;
  if (packing == DicomPacking::kJpegLossless || packing == DicomPacking::kJpegLosslessFirstOrder)
    parameter = &lossless;
  if (packing == DicomPacking::kJpegLs) parameter = &lossless_ls;
  if (packing == DicomPacking::kJpegLsNear) parameter = &near_ls;
  const E_TransferSyntax syntax = syntax_of(packing);
  if (!is_jpeg2000(packing)) PALPATE_CHECK(root.chooseRepresentation(syntax, parameter).good());
  PALPATE_CHECK(root.canWriteXfer(syntax));
  PALPATE_CHECK(format
                    .saveFile(file.c_str(), syntax, EET_ExplicitLength, EGL_recalcGL, EPD_noChange, 0, 0,
                              preamble ? EWM_fileformat : EWM_dataset)
                    .good());
}

void write_masks(const std::filesystem::path& file, const DicomMasks& masks, DicomPacking packing) {
  DcmFileFormat format;
  DcmDataset& root = *format.getDataset();
  put(root, DCM_SOPClassUID,
      masks.type == "LABELMAP" ? "1.2.840.10008.5.1.4.1.1.66.7" : UID_SegmentationStorage);
  put(root, DCM_SOPInstanceUID, std::string("1.2.3.4"));
  put(root, DCM_SeriesInstanceUID, masks.own_series);
  if (!masks.concatenation.empty()) put(root, DCM_ConcatenationUID, masks.concatenation);
  put(root, DCM_Modality, std::string("SEG"));
  if (!masks.character_set.empty()) put(root, DCM_SpecificCharacterSet, masks.character_set);
  put(root, DCM_Rows, masks.rows);
  put(root, DCM_Columns, masks.columns);
  put(root, DCM_SamplesPerPixel, 1);
  put(root, DCM_PhotometricInterpretation,
      std::string(masks.palette.empty() ? "MONOCHROME2" : "PALETTE COLOR"));
  if (!masks.palette.empty()) put_palette(root, masks.palette);
  put(root, DCM_BitsAllocated, masks.bits);
  put(root, DCM_BitsStored, masks.bits);
  put(root, DCM_HighBit, masks.bits - 1);
  put(root, DCM_PixelRepresentation, 0);
  put(root, DCM_SegmentationType, masks.type);
  if (masks.most) put(root, DCM_MaximumFractionalValue, *masks.most);
  if (masks.padding)
    PALPATE_CHECK(
        root.putAndInsertUint16(DcmTag(DCM_PixelPaddingValue, EVR_US), static_cast<Uint16>(*masks.padding))
            .good());
  if (!masks.frame_of_reference.empty()) put(root, DCM_FrameOfReferenceUID, masks.frame_of_reference);
  if (!masks.series.empty())
    put(item_of(root, DCM_ReferencedSeriesSequence), DCM_SeriesInstanceUID, masks.series);
  for (std::size_t n = 0; n < masks.images.size(); ++n)
    put(item_of(item_of(root, DCM_ReferencedSeriesSequence), DCM_ReferencedInstanceSequence,
                static_cast<long>(n)),
        DCM_ReferencedSOPInstanceUID, masks.images[n]);
  const auto put_code = [](DcmItem& item, const DcmTagKey& sequence, const std::string& value,
                           const std::string& scheme, const std::string& meaning) -> DcmItem& {
    DcmItem& code = item_of(item, sequence);
    put(code, DCM_CodeValue, value);
    put(code, DCM_CodingSchemeDesignator, scheme);
    put(code, DCM_CodeMeaning, meaning);
    return code;
  };
  for (std::size_t n = 0; n < masks.segments.size(); ++n) {
    const DicomMasks::Segment& segment = masks.segments[n];
    DcmItem& item = item_of(root, DCM_SegmentSequence, static_cast<long>(n));
    put(item, DCM_SegmentNumber, segment.number);
    put(item, DCM_SegmentLabel, segment.label);
    if (segment.code.empty()) continue;
    DcmItem& type =
        put_code(item, DCM_SegmentedPropertyTypeCodeSequence, segment.code, segment.scheme, segment.meaning);
    if (!segment.side.empty())
      put_code(type, DCM_SegmentedPropertyTypeModifierCodeSequence, segment.side, segment.scheme, "");
  }
  put(root, DCM_NumberOfFrames, std::to_string(masks.frames.size()));
  DcmItem& shared = item_of(root, DCM_SharedFunctionalGroupsSequence);
  put(item_of(shared, DCM_PlaneOrientationSequence), DCM_ImageOrientationPatient, in_text(masks.orientation));
  DcmItem& measures = item_of(shared, DCM_PixelMeasuresSequence);
  put(measures, DCM_PixelSpacing, in_text(masks.spacing_mm));
  put(measures, DCM_SpacingBetweenSlices, masks.slice_spacing_mm);
  std::vector<Uint8> bytes;
  std::vector<Uint16> words;
  std::size_t bit = 0;
  for (std::size_t n = 0; n < masks.frames.size(); ++n) {
    const DicomMasks::Frame& frame = masks.frames[n];
    DcmItem& own = item_of(root, DCM_PerFrameFunctionalGroupsSequence, static_cast<long>(n));
    put(item_of(own, DCM_PlanePositionSequence), DCM_ImagePositionPatient, in_text(frame.position));
    if (masks.type != "LABELMAP")
      put(item_of(own, DCM_SegmentIdentificationSequence), DCM_ReferencedSegmentNumber, frame.segment);
    for (const std::uint16_t value : frame.values) {
      words.push_back(value);
      if (masks.bits == 8) bytes.push_back(static_cast<Uint8>(value));
      if (masks.bits != 1) continue;
      if (bit % 8 == 0) bytes.push_back(0);
      bytes.back() = static_cast<Uint8>(bytes.back() | (value ? 1 << (bit % 8) : 0));
      ++bit;
    }
  }
  if (bytes.size() % 2) bytes.push_back(0);
  PALPATE_CHECK((masks.bits == 16 ? root.putAndInsertUint16Array(DCM_PixelData, words.data(), words.size())
                                  : root.putAndInsertUint8Array(DCM_PixelData, bytes.data(), bytes.size()))
                    .good());
  need_encoders();
  const E_TransferSyntax syntax = syntax_of(packing);
  PALPATE_CHECK(root.chooseRepresentation(syntax, nullptr).good());
  PALPATE_CHECK(format.saveFile(file.c_str(), syntax).good());
}

void write_contours(const std::filesystem::path& file, const DicomContours& contours) {
  DcmFileFormat format;
  DcmDataset& root = *format.getDataset();
  put(root, DCM_SOPClassUID, std::string(UID_RTStructureSetStorage));
  put(root, DCM_SOPInstanceUID, std::string("1.2.3.5"));
  put(root, DCM_SeriesInstanceUID, std::string("1.2.3"));
  put(root, DCM_Modality, std::string("RTSTRUCT"));
  if (!contours.character_set.empty()) put(root, DCM_SpecificCharacterSet, contours.character_set);
  if (!contours.patient.empty()) put_patient(root, contours.patient);
  if (!contours.frame_of_reference.empty()) {
    DcmItem& space = item_of(root, DCM_ReferencedFrameOfReferenceSequence);
    put(space, DCM_FrameOfReferenceUID, contours.frame_of_reference);
    if (!contours.series.empty())
      put(item_of(item_of(space, DCM_RTReferencedStudySequence), DCM_RTReferencedSeriesSequence),
          DCM_SeriesInstanceUID, contours.series);
  }
  for (std::size_t n = 0; n < contours.structures.size(); ++n) {
    const DicomContours::Structure& structure = contours.structures[n];
    const auto index = static_cast<long>(n);
    // numbers in another order than the structures
    const std::string number = std::to_string(90 - n);
    DcmItem& item = item_of(root, DCM_StructureSetROISequence, index);
    put(item, DCM_ROINumber, number);
    put(item, DCM_ROIName, structure.name);
    DcmItem& observed = item_of(root, DCM_RTROIObservationsSequence, index);
    put(observed, DCM_ReferencedROINumber, number);
    if (!structure.code.empty()) {
      DcmItem& code = item_of(observed, DCM_RTROIIdentificationCodeSequence);
      put(code, DCM_CodeValue, structure.code);
      put(code, DCM_CodingSchemeDesignator, structure.scheme);
      put(code, DCM_CodeMeaning, structure.meaning);
    }
    DcmItem& drawn = item_of(root, DCM_ROIContourSequence, index);
    put(drawn, DCM_ReferencedROINumber, number);
    put(drawn, DCM_ROIDisplayColor, std::string("255\\51\\0"));
    for (std::size_t c = 0; c < structure.contours.size(); ++c) {
      const DicomContours::Contour& contour = structure.contours[c];
      DcmItem& one = item_of(drawn, DCM_ContourSequence, static_cast<long>(c));
      put(one, DCM_ContourGeometricType, contour.type);
      put(one, DCM_NumberOfContourPoints,
          std::to_string(contour.declared_points.value_or(static_cast<int>(contour.points.size()))));
      std::string data;
      for (const auto& point : contour.points) data += (data.empty() ? "" : "\\") + in_text(point);
      put(one, DCM_ContourData, contour.data.value_or(data));
    }
  }
  PALPATE_CHECK(format.saveFile(file.c_str(), EXS_LittleEndianExplicit).good());
}

}  // namespace palpate::test
