#include "palpate/catalog/catalog.h"

#include <algorithm>
#include <cstdio>

#include "catalog/local_data.h"
#include "palpate/base/hash.h"
#include "palpate/phantoms/phantoms.h"

namespace palpate {
namespace {

std::vector<CatalogFile> phantom_files(const std::string& stem) {
  return {{.role = DataRole::kLabels, .name = stem + ".seg.nrrd"},
          {.role = DataRole::kScan, .name = stem + ".nrrd"}};
}

CatalogEntry phantom(const std::string& name, const std::string& summary) {
  CatalogEntry entry;
  entry.name = name;
  entry.summary = summary;
  entry.licence = "none needed: generated on this machine, free for any use";
  entry.source = DataSource::kGenerated;
  entry.folder_hint = name;
  entry.files = phantom_files(name);
  return entry;
}

CatalogEntry knee_atlas() {
  CatalogEntry entry;
  entry.name = "knee-atlas";
  entry.summary = "SPL knee atlas (Brigham and Women's Hospital): a left knee, hand segmented";
  entry.licence =
      "3D Slicer License (https://github.com/Slicer/Slicer/blob/main/License.txt): use, change and pass on "
      "under the same terms; made for research, clinical use is neither recommended nor advised";
  entry.home =
      "https://raw.githubusercontent.com/mhalle/spl-knee-atlas/b8cb94143b88775671737e5bcad7783120ea5066";
  entry.folder_hint = "knee_spl";
  entry.files = {{.role = DataRole::kLabels,
                  .name = "seg.nrrd",
                  .remote = "Data/seg.nrrd",
                  .bytes = 466251,
                  .sha256 = "7b1eba4d06a24d8d769fe0342bf57042d6a6d3afb67da04f2749f62007670091"},
                 {.role = DataRole::kNames,
                  .name = "knee.ctbl",
                  .remote = "Data/knee.ctbl",
                  .bytes = 2042,
                  .sha256 = "07cd0f28d8621b31b248e911951ed0d66a1b9b271f82b91e16ee013eb691c2f7"},
                 // its size is not published; the git object id identifies its content
                 {.role = DataRole::kScan,
                  .name = "I.nrrd",
                  .remote = "Data/I.nrrd",
                  .git_blob = "3a6b7473737508b70fdc2c1dd57e2c122ff37795",
                  .required = false}};
  return entry;
}

CatalogEntry head() {
  CatalogEntry entry;
  entry.name = "head";
  entry.summary = "head, T1 MR image (ch2) with the AAL parcellation of its brain, 116 labels, 1 mm";
  entry.licence = "as in /usr/share/doc/mricron-data/copyright (MRIcron: BSD-3-Clause)";
  entry.source = DataSource::kPackage;
  entry.home = "mricron-data";
  entry.folder_hint = "head";
  // no hashes: the package manager verifies the content, and the version may change
  entry.files = {{.role = DataRole::kLabels, .name = "aal.nii.gz"},
                 {.role = DataRole::kScan, .name = "ch2.nii.gz"},
                 {.role = DataRole::kNames, .name = "aal.nii.txt"}};
  return entry;
}

}  // namespace

const std::vector<CatalogEntry>& catalog() {
  static const std::vector<CatalogEntry> kEntries{
      phantom("knee-phantom", "left knee made of geometric primitives, with a synthetic MR image"),
      phantom("shell-phantom", "closed hollow ball, with a synthetic CT image"),
      phantom("skull-phantom", "cranium with thin temples, orbits and a brain, with a synthetic CT image"),
      phantom("gland-phantom",
              "soft gland on a jaw, optionally under fat and skin, with a synthetic MR image"),
      phantom("palpation-block", "block of soft tissue on a plate, with nodules to find"),
      phantom("palpation-dome", "dome of soft tissue, like a breast, with nodules to find"),
      phantom("abdominal-wall", "skin, fat and muscle over the firm edge of a liver and a rib"),
      phantom(
          "temporal-bone",
          "mastoid with air cells, facial nerve, sigmoid sinus and dura, to be drilled, with a synthetic CT "
          "image"),
      knee_atlas(),
      head()};
  return kEntries;
}

const CatalogFile& file_for(const CatalogEntry& entry, DataRole role) {
  const auto file = std::ranges::find(entry.files, role, &CatalogFile::role);
  PALPATE_CHECK(file != entry.files.end());
  return *file;
}

Result<const CatalogEntry*> find_entry(const std::string& name) {
  // parameters are not part of the data set's name
  const std::string base = is_phantom_name(name) ? name.substr(0, name.find(':')) : name;
  std::string known;
  for (const auto& entry : catalog()) {
    if (entry.name == base) return &entry;
    known += (known.empty() ? "" : ", ") + entry.name;
  }
  return Error{ErrorKind::kBadInput, "there is no data set with this name", name,
               "the data sets are " + known};
}

Result<CatalogEntry> entry_with_parameters(const std::string& name) {
  const auto found = find_entry(name);
  if (!found) return found.error();
  if (!is_phantom_name(name)) return **found;
  const auto parameters = parse_phantom(name);
  if (!parameters) return parameters.error();
  CatalogEntry entry = **found;
  entry.name = phantom_name(*parameters);
  entry.folder_hint = file_stem(entry.name);
  entry.files = phantom_files(entry.folder_hint);
  return entry;
}

std::string file_stem(const std::string& name) {
  // leaves space for extensions within the maximum length of a file name
  constexpr std::size_t kMaxStem = 200;
  std::string stem = name;
  // colons separate the folders of PALPATE_DATA
  std::ranges::replace(stem, ':', '_');
  if (stem.size() <= kMaxStem) return stem;
  std::uint64_t hash = kHashSeed;
  hash_bytes(hash, name.data(), name.size());
  char digits[24];
  std::snprintf(digits, sizeof digits, "_%016llx", static_cast<unsigned long long>(hash_finish(hash)));
  return stem.substr(0, stem.find('_')) + digits;
}

}  // namespace palpate
