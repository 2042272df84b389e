#include <dcmtk/config/osconfig.h>

#include <dcmtk/dcmdata/dcdeftag.h>

#include <set>

#include "volume_io/dicom/dicom_elements.h"
#include "volume_io/dicom/dicom_readers.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

// calls visit(item) for each item of a sequence
template <class Visit>
void for_each_item(DcmItem& item, const DcmTagKey& sequence, const Visit& visit) {
  for (DcmItem* each : items_of(item, sequence)) visit(*each);
}

}  // namespace

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

}  // namespace palpate::volume_io
