#include "volume_io/dicom/dicom_library.h"

#include <dcmtk/config/osconfig.h>

#include <dcmtk/dcmdata/dcdict.h>
#include <dcmtk/dcmjpeg/djdecode.h>
#include <dcmtk/dcmjpls/djdecode.h>
#include <dcmtk/oflog/oflog.h>

#include "volume_io/dicom/dicom_elements.h"
#include "volume_io/dicom/dicom_readers.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

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
    return read_images(name, syntax_uid);
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
    return open_file_pixels(name);
  }
};

}  // namespace
}  // namespace palpate::volume_io

palpate::volume_io::DicomLibrary* palpate_dicom_library() {
  static palpate::volume_io::DcmtkFiles files;
  return &files;
}
