#include <map>
#include <set>
#include <tuple>

#include "palpate/volume_io/identifiers.h"
#include "volume_io/dicom/dicom_process.h"
#include "volume_io/volume_message.h"

namespace palpate {

using namespace volume_io;

std::string description_of(IdentifierKind kind) {
  constexpr const char* kWords[kIdentifierKinds] = {
      "names of persons",        "numbers and addresses", "characteristics of the patient",
      "dates and times",         "unique identifiers",    "free text",
      "institution and station", "private elements",      "in or over the image"};
  return kWords[static_cast<std::size_t>(kind)];
}

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxRows = 10'000;

// Identifiers of all files by kind and element, sorted by tag, which follows the keyword in `what`.
struct IdentifierRows {
  using Key = std::tuple<IdentifierKind, std::string, std::string>;
  static Key key_of(const DicomIdentifier& one) {
    const auto tag = std::min(one.what.rfind('('), one.what.size());
    return {one.kind, one.what.substr(tag), one.what};
  }
  std::map<Key, IdentifierRow> rows;
  std::map<Key, std::set<std::string>> values;
  std::set<std::string> beyond;  // elements beyond kMaxRows, at most as many again
  std::size_t files = 0, burnt_in_unstated = 0, unread = 0;
};

bool says_nothing_is_burnt_in(const DicomIdentifier& identifier) {
  return identifier.what.starts_with("BurnedInAnnotation") && identifier.value == "NO";
}

void put_identifiers(const std::vector<DicomIdentifier>& found, bool picture_declared, IdentifierRows& all) {
  ++all.files;
  all.burnt_in_unstated += !picture_declared;
  std::set<IdentifierRows::Key> in_file;
  for (const DicomIdentifier& one : found) {
    if (says_nothing_is_burnt_in(one)) continue;
    const auto key = IdentifierRows::key_of(one);
    if (all.rows.size() == kMaxRows && !all.rows.contains(key)) {
      if (all.beyond.size() < kMaxRows) all.beyond.insert(one.what);
      continue;
    }
    IdentifierRow& row = all.rows[key];
    row.kind = one.kind;
    row.what = one.what;
    row.files += in_file.insert(key).second;
    auto& values = all.values[key];
    if (values.size() < kMaxIdentifierValues) values.insert(one.value);
    if (row.example.empty()) row.example = one.value;
  }
}

bool send_identifiers(DicomLibrary& library, reader::ParentEnd& parent, const FoundFiles& found) {
  library.begin_reading();
  IdentifierRows all;
  for (std::size_t n = 0; n < found.files.size(); ++n) {
    const auto begun = static_cast<std::uint32_t>(n);
    if (!parent.write(std::as_bytes(std::span(&begun, 1)))) return false;
    const fs::path& file = found.files[n];
    const auto kind = dicom_kind_of(file, front_of(file));
    if (!kind) continue;
    const auto opened = InputFile::open(file);
    const auto identifiers = opened ? library.read_identifiers(opened->name_for_libraries())
                                    : Result<std::vector<DicomIdentifier>>(opened.error());
    if (!identifiers) {
      ++all.unread;
      continue;
    }
    const bool image = kind->dicom_image;
    bool states_burn_in = !image;
    for (const DicomIdentifier& one : *identifiers)
      states_burn_in = states_burn_in || one.what.starts_with("BurnedInAnnotation");
    put_identifiers(*identifiers, states_burn_in, all);
  }
  if (!send_end(parent, {})) return false;
  reader::Sender out(parent);
  for (const std::size_t number :
       {all.files, all.burnt_in_unstated, all.unread, all.beyond.size(), all.rows.size()})
    out.put(static_cast<std::uint32_t>(number));
  for (const auto& [key, row] : all.rows) {
    out.put(static_cast<std::uint8_t>(row.kind));
    out.put(row.what);
    out.put(static_cast<std::uint32_t>(row.files));
    out.put(static_cast<std::uint32_t>(all.values[key].size()));
    out.put(row.example);
  }
  return out.ok();
}

}  // namespace

Result<IdentifierReport> find_identifiers(const std::filesystem::path& file, bool values,
                                          const Progress& progress) try {
  const auto library = ready_dicom_library();
  if (!library) return at_file(file, library.error());
  auto found = find_files(file, progress);
  if (!found) return found.error();
  // the DICOMDIR itself contains a record of each patient
  if (is_dicom_directory(file)) found->files.push_back(file);
  auto process = start_dicom_reader(*found, 0, progress, [&](reader::ParentEnd& parent) {
    return send_identifiers(**library, parent, *found);
  });
  if (!process) return at_file(file, process.error());
  const Files named{&file, 1};
  if (auto result = wait_for_files(**process, *found, named, progress); !result) return result.error();
  reader::Receiver in(**process, "is damaged: ");
  std::uint32_t files = 0, unsaid = 0, unread = 0, beyond = 0, rows = 0;
  for (std::uint32_t* number : {&files, &unsaid, &unread, &beyond, &rows}) in.get(*number);
  if (rows > kMaxRows) return impossible_volume(named);
  IdentifierReport report;
  report.files = files;
  report.burnt_in_unstated = unsaid;
  for (std::uint32_t n = 0; n < rows && in.ok(); ++n) {
    IdentifierRow& row = report.rows.emplace_back();
    std::uint8_t kind = 0;
    std::uint32_t in_files = 0, different = 0;
    in.get(kind);
    in.get(row.what);
    in.get(in_files);
    in.get(different);
    in.get(row.example);
    if (kind >= kIdentifierKinds) return impossible_volume(named);
    row.kind = static_cast<IdentifierKind>(kind);
    row.files = in_files;
    row.different = different;
    if (!values) row.example.clear();
  }
  if (!in.ok()) return about(in.error(), named);
  report.notes = found->notes;
  if (unread > 0) report.notes.push_back(counted(unread, "DICOM file", "DICOM files") + " could not be read");
  if (beyond > 0)
    report.notes.push_back("has " + std::to_string(beyond) + (beyond == kMaxRows ? " or more" : "") +
                           " further elements, which are not listed");
  if (files == 0)
    return bad_input(file.string(), "holds no DICOM file that can be read",
                     "palpate ignores data other than voxels in other formats: docs/reference/formats.md");
  return report;
} catch (const std::bad_alloc&) {
  return bad_input(file.string(), "does not fit into the memory",
                   "close other programs, or choose a smaller folder");
}

}  // namespace palpate
