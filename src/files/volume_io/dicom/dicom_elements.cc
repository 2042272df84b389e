#include "volume_io/dicom/dicom_elements.h"

#include <dcmtk/dcmdata/dcdeftag.h>
#include <dcmtk/dcmdata/dcpixseq.h>
#include <dcmtk/dcmdata/dcsequen.h>

#include <cmath>

#include "volume_io/dicom/dicom_characters.h"

namespace palpate::volume_io {
namespace {

// values longer than this are loaded on access; bytes
constexpr Uint32 kAtOnce = 4096;

}  // namespace

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

std::string in_words(Loaded loaded, const std::string& kind) {
  return loaded == Loaded::kCutShort ? "is a " + kind + " that ends within an element, so it was cut short"
                                     : "is a damaged " + kind;
}

std::string in_words(const DcmTagKey& key) {
  DcmTag tag(key);
  return std::string(tag.getTagName()) + " " + key.toString().c_str();
}

bool has_plausible_length(DcmItem& item, const DcmTagKey& tag) {
  constexpr Uint32 kMaxLength_bytes = 1 << 16;
  DcmElement* element = nullptr;
  return item.findAndGetElement(tag, element).good() && element &&
         element->getLengthField() <= kMaxLength_bytes;
}

std::optional<double> number_of(DcmItem& item, const DcmTagKey& tag, unsigned long at) {
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

std::string name_text_of(DcmItem& item, const DcmTagKey& tag, const std::string& set) {
  const std::string text = text_of(item, tag);
  // Text that is invalid in its character set is returned unchanged; as invalid UTF-8 it is not accepted as a
  // name.
  return dicom_text_in_utf8(text, set).value_or(text);
}

Code code_of(DcmItem& item, const DcmTagKey& sequence, const std::string& set) {
  DcmItem* code = nullptr;
  if (item.findAndGetSequenceItem(sequence, code).bad() || !code) return {};
  return {text_of(*code, DCM_CodeValue), text_of(*code, DCM_CodingSchemeDesignator),
          name_text_of(*code, DCM_CodeMeaning, set)};
}

DcmItem& Attributes::in(const DcmTagKey& group, const DcmTagKey& tag) const {
  for (DcmItem* dcm_item : items_) {
    DcmItem* item = nullptr;
    if (dcm_item && dcm_item->findAndGetSequenceItem(group, item).good() && item && item->tagExists(tag))
      return *item;
  }
  return root_;
}

std::vector<DcmItem*> items_of(DcmItem& root, const DcmTagKey& tag) {
  std::vector<DcmItem*> items;
  DcmSequenceOfItems* sequence = nullptr;
  if (root.findAndGetSequence(tag, sequence).bad() || !sequence) return items;
  for (DcmObject* item = sequence->nextInContainer(nullptr); item; item = sequence->nextInContainer(item))
    if (auto* plain = dynamic_cast<DcmItem*>(item)) items.push_back(plain);
  return items;
}

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

bool append(DcmPixelItem& fragment, std::size_t bytes, DcmFileCache& cache,
            std::vector<std::uint8_t>& target) {
  const std::size_t before = target.size();
  target.resize(before + bytes);
  return bytes == 0 ||
         fragment
             .getPartialValue(target.data() + before, 0, static_cast<Uint32>(bytes), &cache, EBO_LittleEndian)
             .good();
}

}  // namespace palpate::volume_io
