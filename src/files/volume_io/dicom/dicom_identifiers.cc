#include "volume_io/dicom/dicom_identifiers.h"

#include <dcmtk/config/osconfig.h>

#include <dcmtk/dcmdata/dcdeftag.h>
#include <dcmtk/dcmdata/dcfilefo.h>
#include <dcmtk/dcmdata/dcitem.h>
#include <dcmtk/dcmdata/dcmetinf.h>
#include <dcmtk/dcmdata/dcsequen.h>

#include <algorithm>
#include <array>
#include <optional>
#include <string_view>
#include <utility>

#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

constexpr Uint32 kReadAtOnce = 1 << 16;

struct NamedKind {
  DcmTagKey tag;
  IdentifierKind kind;
};

// attributes of Table E.1-1 whose kind does not follow from type and keyword
const NamedKind kByTag[] = {
    {DCM_PatientID, IdentifierKind::kId},
    {DCM_RETIRED_OtherPatientIDs, IdentifierKind::kId},
    {DCM_IssuerOfPatientID, IdentifierKind::kId},
    {DCM_AccessionNumber, IdentifierKind::kId},
    {DCM_StudyID, IdentifierKind::kId},
    {DCM_AdmissionID, IdentifierKind::kId},
    {DCM_ServiceEpisodeID, IdentifierKind::kId},
    {DCM_RequestedProcedureID, IdentifierKind::kId},
    {DCM_ScheduledProcedureStepID, IdentifierKind::kId},
    {DCM_PerformedProcedureStepID, IdentifierKind::kId},
    {DCM_FillerOrderNumberImagingServiceRequest, IdentifierKind::kId},
    {DCM_PlacerOrderNumberImagingServiceRequest, IdentifierKind::kId},
    {DCM_MilitaryRank, IdentifierKind::kId},
    {DCM_BranchOfService, IdentifierKind::kId},
    {DCM_RETIRED_MedicalRecordLocator, IdentifierKind::kId},
    {DCM_PatientAddress, IdentifierKind::kId},
    {DCM_PatientTelephoneNumbers, IdentifierKind::kId},
    {DCM_CountryOfResidence, IdentifierKind::kId},
    {DCM_RegionOfResidence, IdentifierKind::kId},
    {DCM_DeviceSerialNumber, IdentifierKind::kId},
    {DCM_DetectorID, IdentifierKind::kId},
    {DCM_PlateID, IdentifierKind::kId},
    {DCM_CassetteID, IdentifierKind::kId},
    {DCM_GantryID, IdentifierKind::kId},
    {DCM_PatientSex, IdentifierKind::kPatient},
    {DCM_PatientAge, IdentifierKind::kPatient},
    {DCM_PatientSize, IdentifierKind::kPatient},
    {DCM_PatientWeight, IdentifierKind::kPatient},
    {DCM_EthnicGroup, IdentifierKind::kPatient},
    {DCM_Occupation, IdentifierKind::kPatient},
    {DCM_SmokingStatus, IdentifierKind::kPatient},
    {DCM_PregnancyStatus, IdentifierKind::kPatient},
    {DCM_PatientReligiousPreference, IdentifierKind::kPatient},
    {DCM_PatientSexNeutered, IdentifierKind::kPatient},
    {DCM_MedicalAlerts, IdentifierKind::kPatient},
    {DCM_Allergies, IdentifierKind::kPatient},
    {DCM_PatientState, IdentifierKind::kPatient},
    {DCM_InstitutionName, IdentifierKind::kInstitution},
    {DCM_InstitutionAddress, IdentifierKind::kInstitution},
    {DCM_InstitutionalDepartmentName, IdentifierKind::kInstitution},
    {DCM_StationName, IdentifierKind::kInstitution},
    {DCM_CurrentPatientLocation, IdentifierKind::kInstitution},
    {DCM_PerformedLocation, IdentifierKind::kInstitution},
    {DCM_RequestingService, IdentifierKind::kInstitution},
    {DCM_StudyDescription, IdentifierKind::kText},
    {DCM_SeriesDescription, IdentifierKind::kText},
    {DCM_ProtocolName, IdentifierKind::kText},
    {DCM_AdmittingDiagnosesDescription, IdentifierKind::kText},
    {DCM_ContrastBolusAgent, IdentifierKind::kText},
    {DCM_RequestedProcedureDescription, IdentifierKind::kText},
    {DCM_PerformedProcedureStepDescription, IdentifierKind::kText},
    {DCM_ScheduledProcedureStepDescription, IdentifierKind::kText},
    {DCM_ReasonForTheRequestedProcedure, IdentifierKind::kText},
    {DCM_SegmentLabel, IdentifierKind::kText},
    {DCM_ROIName, IdentifierKind::kText},
    {DCM_StructureSetLabel, IdentifierKind::kText},
    {DCM_StructureSetName, IdentifierKind::kText},
    {DCM_ContentLabel, IdentifierKind::kText},
    {DCM_ContentDescription, IdentifierKind::kText},
    {DCM_AcquisitionDeviceProcessingDescription, IdentifierKind::kText},
    {DCM_DerivationDescription, IdentifierKind::kText},
    {DCM_UserContentLabel, IdentifierKind::kText},
    {DCM_TimezoneOffsetFromUTC, IdentifierKind::kDate},
    {DCM_EncapsulatedDocument, IdentifierKind::kPicture},
    {DCM_RecognizableVisualFeatures, IdentifierKind::kPicture},
    {DCM_UnformattedTextValue, IdentifierKind::kPicture},
};

// UIDs defined by the standard itself, which do not identify a patient
bool is_of_standard(std::string_view uid) {
  return uid.starts_with("1.2.840.10008.");
}

// kind of an element with a value; nullopt if it does not identify a patient
std::optional<IdentifierKind> kind_of_element(DcmElement& element, const std::string& value) {
  const DcmTag& tag = element.getTag();
  const Uint16 group = tag.getGroup();
  if (group % 2 == 1) return IdentifierKind::kPrivate;
  // curves and overlays have repeating groups
  constexpr Uint16 kCurves = 0x5000, kOverlays = 0x6000, kLastBit = 0xFF00;
  if ((group & kLastBit) == kCurves || ((group & kLastBit) == kOverlays && tag.getElement() == 0x3000))
    return IdentifierKind::kPicture;
  // clinical trials
  constexpr Uint16 kTrials = 0x0012;
  if (group == kTrials && element.ident() != EVR_UI && element.ident() != EVR_DA) return IdentifierKind::kId;
  if (tag == DCM_BurnedInAnnotation) return IdentifierKind::kPicture;
  for (const NamedKind& named : kByTag)
    if (tag == named.tag) return named.kind;
  switch (element.ident()) {
    case EVR_PN:
      return IdentifierKind::kName;
    case EVR_DA:
    case EVR_DT:
    case EVR_TM:
      return IdentifierKind::kDate;
    case EVR_ST:
    case EVR_LT:
    case EVR_UT:
    case EVR_UC:
      return IdentifierKind::kText;
    case EVR_AE:
      return IdentifierKind::kInstitution;
    case EVR_UI:
      return is_of_standard(value) ? std::nullopt : std::optional(IdentifierKind::kUid);
    default:
      break;
  }
  // comments and descriptions, regardless of tag and type
  DcmTag named(tag);
  const std::string_view keyword = named.getTagName();
  for (const std::string_view end : {"Comments", "Description"})
    if (keyword.ends_with(end)) return IdentifierKind::kText;
  // Keyword endings of other short texts; the keywords below describe a product, not a patient.
  if (element.ident() != EVR_LO && element.ident() != EVR_SH) return std::nullopt;
  for (const std::string_view product :
       {"ManufacturerModelName", "SegmentAlgorithmName", "ImplementationVersionName"})
    if (keyword == product) return std::nullopt;
  constexpr std::pair<std::string_view, IdentifierKind> kEnds[] = {
      {"ID", IdentifierKind::kId},
      {"IDs", IdentifierKind::kId},
      {"Identifier", IdentifierKind::kId},
      {"Identification", IdentifierKind::kId},
      {"Address", IdentifierKind::kId},
      {"Numbers", IdentifierKind::kId},
      {"Residence", IdentifierKind::kInstitution},
      {"Location", IdentifierKind::kInstitution},
      {"Organization", IdentifierKind::kInstitution},
      {"Name", IdentifierKind::kInstitution},
      {"Label", IdentifierKind::kText}};
  for (const auto& [end, kind] : kEnds)
    if (keyword.ends_with(end)) return kind;
  return std::nullopt;
}

std::string words_of(DcmElement& element) {
  constexpr std::size_t kMaxLength_bytes = 64;
  OFString text;
  if (element.getLengthField() <= kReadAtOnce && element.isaString() &&
      element.getOFStringArray(text).good()) {
    std::string words(text.c_str(), text.size());
    if (words.size() > kMaxLength_bytes) words = words.substr(0, kMaxLength_bytes) + " ...";
    return words;
  }
  return std::to_string(element.getLengthField()) + " bytes";
}

class IdentifierCollector {
 public:
  std::vector<DicomIdentifier> found;

  void visit(DcmItem& item, int depth) {
    // deeper than any real file
    constexpr int kDeepest = 32;
    if (depth > kDeepest) return;
    DcmObject* object = nullptr;
    while ((object = item.nextInContainer(object)) != nullptr) {
      auto* element = dynamic_cast<DcmElement*>(object);
      if (!element) continue;
      if (auto* sequence = dynamic_cast<DcmSequenceOfItems*>(element); sequence && !is_pixels(*element)) {
        if (element->getTag().getGroup() % 2 == 1)
          found.push_back({IdentifierKind::kPrivate, name_of(*element), "a sequence"});
        for (unsigned long n = 0; n < sequence->card(); ++n)
          if (DcmItem* inner = sequence->getItem(n)) visit(*inner, depth + 1);
        continue;
      }
      // private creator elements, which name the vendor, are reported as private elements too
      if (is_pixels(*element) || element->getLengthField() == 0) continue;
      const std::string value = words_of(*element);
      if (value.empty()) continue;
      if (const auto kind = kind_of_element(*element, value))
        found.push_back({*kind, name_of(*element), value});
    }
  }

 private:
  static bool is_pixels(DcmElement& element) { return element.getTag() == DCM_PixelData; }
  static std::string name_of(DcmElement& element) {
    DcmTag tag(element.getTag());
    const std::string number = tag.getXTag().toString().c_str();
    return (tag.getGroup() % 2 == 1 ? std::string("private") : std::string(tag.getTagName())) + " " + number;
  }
};

}  // namespace

Result<std::vector<DicomIdentifier>> identifiers_of_dicom(const std::filesystem::path& name) {
  DcmFileFormat file;
  if (file.loadFile(name.c_str(), EXS_Unknown, EGL_noChange, kReadAtOnce, ERM_autoDetect).bad())
    return bad_input("", "is a damaged DICOM file", "copy it again");
  IdentifierCollector collector;
  if (DcmMetaInfo* meta = file.getMetaInfo()) collector.visit(*meta, 0);
  collector.visit(*file.getDataset(), 0);
  return std::move(collector.found);
}

Result<std::vector<std::vector<std::string>>> files_of_dicomdir(const std::filesystem::path& name) {
  DcmFileFormat file;
  DcmSequenceOfItems* records = nullptr;
  if (file.loadFile(name.c_str(), EXS_Unknown, EGL_noChange, kReadAtOnce, ERM_autoDetect).bad() ||
      file.getDataset()->findAndGetSequence(DCM_DirectoryRecordSequence, records).bad() || !records)
    return bad_input("", "is a damaged DICOMDIR", "copy it again, or give its folder");
  std::vector<std::vector<std::string>> files;
  for (unsigned long n = 0; n < records->card(); ++n) {
    DcmItem* record = records->getItem(n);
    DcmElement* element = nullptr;
    if (!record || record->findAndGetElement(DCM_ReferencedFileID, element).bad() || !element ||
        element->getLengthField() == 0 || element->getLengthField() > kReadAtOnce)
      continue;
    std::vector<std::string> parts;
    for (unsigned long part = 0; part < element->getVM(); ++part) {
      OFString text;
      if (element->getOFString(text, part).bad()) break;
      parts.emplace_back(text.c_str(), text.size());
    }
    files.push_back(std::move(parts));
  }
  if (files.empty()) return bad_input("", "names no file (ReferencedFileID (0004,1500))", "give its folder");
  return files;
}

}  // namespace palpate::volume_io
