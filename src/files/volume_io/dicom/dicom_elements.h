#pragma once

#include <dcmtk/config/osconfig.h>

#include <dcmtk/dcmdata/dcfcache.h>
#include <dcmtk/dcmdata/dcfilefo.h>
#include <dcmtk/dcmdata/dcitem.h>
#include <dcmtk/dcmdata/dcpixel.h>
#include <dcmtk/dcmdata/dcpxitem.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "volume_io/dicom/dicom_fault.h"

/// Loading of DICOM files and access to the values of their elements, by DCMTK. The bytes are untrusted.
namespace palpate::volume_io {

inline constexpr const char* kDecompress =
    "decompress it (gdcmconv --raw IN OUT), or load the series in 3D Slicer and save it as NRRD";
inline constexpr const char* kSlicer = "load the series in 3D Slicer and save it as NRRD";
inline constexpr const char* kExport = "export the series again, as CT or MR images";
inline constexpr const char* kDamagedStructures = "is a damaged DICOM structure set";

/// Completeness of a file.
enum class Loaded {
  kWhole,
  kCutShort,  ///< Its bytes end before its last element does.
  kDamaged,
};
/// Loads a file; values longer than 4096 bytes stay in it until they are accessed.
Loaded load(DcmFileFormat& file, const std::filesystem::path& name);
/// Description of an incomplete file.
/// @param kind  "DICOM segmentation"
std::string in_words(Loaded loaded, const std::string& kind);
/// "PixelSpacing (0028,0030)"
std::string in_words(const DcmTagKey& key);

/// Whether an element exists and its length is plausible for its values: DCMTK allocates whatever the length
/// field says.
bool has_plausible_length(DcmItem& item, const DcmTagKey& tag);
/// Value of an element as a finite number, whatever its representation; nullopt if there is none.
/// @param at  index among the element's values
std::optional<double> number_of(DcmItem& item, const DcmTagKey& tag, unsigned long at = 0);
/// Value of an element of type US.
std::optional<int> count_of(DcmItem& item, const DcmTagKey& tag);
/// Raw bytes of an element's text; empty if there is none.
std::string text_of(DcmItem& item, const DcmTagKey& tag);
/// Text of an element, converted from the file's character set to UTF-8.
/// @param set  SpecificCharacterSet (0008,0005)
std::string name_text_of(DcmItem& item, const DcmTagKey& tag, const std::string& set);

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

/// Item of a code sequence.
struct Code {
  std::string value, scheme, meaning;
};
/// First item of a code sequence; empty if there is none.
/// @param set  SpecificCharacterSet (0008,0005)
Code code_of(DcmItem& item, const DcmTagKey& sequence, const std::string& set);

/// Attribute lookup of a frame: per-frame functional groups, shared functional groups, data set.
class Attributes {
 public:
  Attributes(DcmItem* own, DcmItem* shared, DcmItem& root) : items_{own, shared}, root_(root) {}

  /// Item that contains an attribute: the functional group or, as in single-frame files, the data set.
  DcmItem& in(const DcmTagKey& group, const DcmTagKey& tag) const;
  std::optional<double> number(const DcmTagKey& group, const DcmTagKey& tag) const {
    return number_of(in(group, tag), tag);
  }

 private:
  std::array<DcmItem*, 2> items_;
  DcmItem& root_;
};

/// Items of a sequence in order; DCMTK's access by index counts from the first item each time.
std::vector<DcmItem*> items_of(DcmItem& root, const DcmTagKey& tag);
/// Items of encapsulated pixel data: first the offset table, then the fragments.
std::vector<DcmPixelItem*> fragments_of(DcmPixelData& pixels, E_TransferSyntax syntax);
/// Appends the first `bytes` bytes of a fragment; returns false if they cannot be read.
bool append(DcmPixelItem& fragment, std::size_t bytes, DcmFileCache& cache,
            std::vector<std::uint8_t>& target);

}  // namespace palpate::volume_io
