#include <algorithm>
#include <set>

#include "palpate/base/file.h"
#include "volume_io/dicom/dicom_process.h"
#include "volume_io/dicom/dicom_study.h"
#include "volume_io/volume_message.h"

namespace palpate {

using namespace volume_io;

namespace {

namespace fs = std::filesystem;

// Matches a segmentation with the images on which it may have been made: sends the number of the volume and
// the notes.
bool serve_dicom_match(DicomLibrary& library, reader::ParentEnd& parent, const FoundFiles& found,
                       const fs::path& segmentation, const std::vector<fs::path>& files, bool one_series,
                       std::optional<int> number) {
  const auto content = find_content(library, parent, found);
  if (!content) return send_end(parent, content.error());
  const auto refused = [&](Error error, const fs::path& file) {
    error.where = file.string();
    return send_end(parent, error);
  };
  DicomReference reference;
  std::set<std::string> series;
  for (const fs::path& file : files) {
    const auto opened = InputFile::open(file);
    if (!opened) return send_end(parent, opened.error());
    const auto one = library.read_reference(opened->name_for_libraries());
    if (!one) return refused(one.error(), file);
    series.insert(one->own_series);
    reference.series.insert(one->series.begin(), one->series.end());
    reference.images.insert(one->images.begin(), one->images.end());
    reference.frames_of_reference.insert(one->frames_of_reference.begin(), one->frames_of_reference.end());
  }
  if (one_series && series.size() > 1)
    return refused(bad_input("",
                             "holds " + std::to_string(files.size()) + " segmentations of " +
                                 std::to_string(series.size()) + " series, which may be different readings",
                             "give one of them after the images, or this folder to read all of them as one"),
                   segmentation);
  const auto chosen = choose_segmented(
      content->volumes, relations_of(reference, content->volumes, content->identifiers), number);
  if (!chosen) return refused(chosen.error(), segmentation);
  if (!send_end(parent, {})) return false;
  reader::Sender out(parent);
  out.put(static_cast<std::uint32_t>(chosen->index + 1));
  out.put(static_cast<std::uint32_t>(chosen->is_declared));
  out.put(static_cast<std::uint32_t>(chosen->notes.size()));
  for (const std::string& note : chosen->notes) out.put(note);
  return out.ok();
}

bool is_dicom_labels(const fs::path& file) {
  const auto kind = kind_of_dicom_file(file);
  return kind && (kind->dicom_segmentation || kind->dicom_structures);
}

// label files of a named path: the file itself, or a folder of segmentations
std::vector<fs::path> label_files(const fs::path& named) {
  if (is_dicom_labels(named)) return {named};
  return dicom_segmentation_files(named);
}

// segmentations below a folder, ordered by name
Result<std::vector<fs::path>> segmentations_in(const fs::path& folder, const Progress& progress) {
  auto found = find_files(folder, progress);
  if (!found) return found.error();
  std::erase_if(found->files, [](const fs::path& file) { return !is_dicom_labels(file); });
  return std::move(found->files);
}

// deepest folder that contains all files
fs::path common_folder(const std::vector<fs::path>& files) {
  fs::path folder = files.front().parent_path();
  for (const fs::path& file : files) {
    const auto is_below = [&] { return !file.lexically_relative(folder).string().starts_with(".."); };
    while (folder.has_relative_path() && !is_below()) folder = folder.parent_path();
  }
  return folder;
}

// @param one_series  segmentations of several series are an error
Result<Study> matched(Study study, bool one_series, const Progress& progress) {
  const auto library = ready_dicom_library();
  if (!library) return at_file(study.scan, library.error());
  auto found = find_files(study.scan, progress);
  if (!found) return found.error();
  found->roots.push_back(*study.labels);
  const std::vector<fs::path> files = label_files(*study.labels);
  auto process = start_dicom_reader(*found, 0, progress, [&](reader::ParentEnd& parent) {
    return serve_dicom_match(**library, parent, *found, *study.labels, files, one_series, study.volume);
  });
  if (!process) return at_file(study.scan, process.error());
  std::vector<fs::path> named{study.scan, *study.labels};
  named.insert(named.end(), files.begin(), files.end());
  if (auto result = wait_for_files(**process, *found, named, progress); !result) return result.error();
  reader::Receiver in(**process, "is damaged: ");
  std::uint32_t number = 0, is_declared = 0, notes = 0;
  in.get(number);
  in.get(is_declared);
  in.get(notes);
  constexpr std::uint32_t kMaxNumber = 100'000, kMaxStudyNotes = 10;
  if (number < 1 || number > kMaxNumber || notes > kMaxStudyNotes) return impossible_volume(named);
  for (std::uint32_t n = 0; n < notes && in.ok(); ++n) {
    in.get(study.notes.emplace_back());
    study.notes.back() = study.labels->string() + " " + study.notes.back();
  }
  if (!in.ok()) return about(in.error(), named);
  study.volume = static_cast<int>(number);
  study.is_declared = is_declared == 1;
  return study;
}

}  // namespace

Result<Study> find_study(const std::filesystem::path& scan,
                         const std::optional<std::filesystem::path>& labels, std::optional<int> volume,
                         const Progress& progress) try {
  Study study{.scan = scan, .volume = volume, .labels = labels, .notes = {}};
  std::error_code ignored;
  const bool images = is_dicom(scan);
  if (!labels) {
    if (!images || !(std::filesystem::is_directory(scan, ignored) || is_dicom_directory(scan))) return study;
    const auto segmentations = segmentations_in(scan, progress);
    if (!segmentations) return segmentations.error();
    if (segmentations->empty()) return study;
    if (segmentations->size() > 1) {
      std::string list;
      constexpr std::size_t kListed = 10;
      for (std::size_t n = 0; n < std::min(segmentations->size(), kListed); ++n)
        list += (n ? ", " : " ") + (*segmentations)[n].string();
      if (segmentations->size() > kListed) list += ", ...";
      // a segmentation that is spread over several files is a folder per series
      const fs::path folder = common_folder(*segmentations);
      if (dicom_segmentation_files(folder).size() != segmentations->size())
        return Error{
            ErrorKind::kUsage,
            "holds " + std::to_string(segmentations->size()) +
                " segmentations in addition to its images:" + list,
            scan.string(),
            "give one of them after the folder; or put the files of one segmentation into a separate folder "
            "and give that; or give the images alone with --scan: palpate scene new"};
      study.labels = folder;
    } else {
      study.labels = segmentations->front();
    }
  }
  if (label_files(*study.labels).empty()) return study;
  if (images) return matched(std::move(study), !labels, progress);
  study.is_declared = false;
  study.notes.push_back(study.labels->string() + " states the images it was made on, but " + scan.string() +
                        " does not identify itself: whether they belong together was not checked");
  return study;
} catch (const std::bad_alloc&) {
  return bad_input(scan.string(), "does not fit into the memory",
                   "close other programs, or choose a smaller folder");
}

}  // namespace palpate
