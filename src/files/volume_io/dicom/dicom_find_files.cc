#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <set>

#include "palpate/base/reading.h"
#include "volume_io/dicom/dicom_process.h"
#include "volume_io/formats/formats.h"
#include "volume_io/labels/label_text.h"

namespace palpate::volume_io {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxFolderDepth = 16;

// Calls visit(file) for each regular file in a folder or below it, until it returns true. Links that leave
// the folder are skipped unless they are allowed; returns their number.
template <class Visit>
std::size_t walk(const fs::path& folder, const Visit& visit) {
  std::size_t outside_links = 0;
  std::error_code failed;
  fs::recursive_directory_iterator entry(folder, fs::directory_options::skip_permission_denied, failed);
  for (; !failed && entry != fs::recursive_directory_iterator(); entry.increment(failed)) {
    if (entry.depth() >= kMaxFolderDepth) entry.disable_recursion_pending();
    std::error_code ignored;
    if (!entry->is_regular_file(ignored)) continue;
    if (entry->is_symlink(ignored) && !check_stays_in(folder, entry->path()))
      ++outside_links;
    else if (visit(entry->path()))
      break;
  }
  return outside_links;
}

bool is_dicom_image(const fs::path& file) {
  const auto kind = dicom_kind_of(file, front_of(file));
  return kind && kind->dicom_image;
}

constexpr std::size_t kMaxParts = 16, kMaxPart = 255;

// Path of a file that a DICOMDIR references; nullopt if it would leave the folder.
std::optional<fs::path> path_of_part(const fs::path& folder, const std::vector<std::string>& parts,
                                     bool lower) {
  fs::path directory = folder;
  if (parts.empty() || parts.size() > kMaxParts) return std::nullopt;
  for (const std::string& part : parts) {
    if (part.empty() || part.size() > kMaxPart || part == "." || part == ".." ||
        part.find('/') != std::string::npos || part.find('\\') != std::string::npos ||
        part.find('\0') != std::string::npos)
      return std::nullopt;
    directory /= lower ? lower_case(part) : part;
  }
  return directory;
}

// Files referenced by a DICOMDIR. Errors: interrupted; a damaged DICOMDIR; a reference to a file elsewhere.
Result<FoundFiles> files_named_by(const fs::path& directory, const Progress& progress) {
  const auto library = ready_dicom_library();
  if (!library) return at_file(directory, library.error());
  FoundFiles itself;
  itself.roots = itself.files = {directory};
  auto process = start_dicom_reader(itself, 0, progress, [&](reader::ParentEnd& parent) {
    (*library)->begin_reading();
    const auto opened = InputFile::open(directory);
    if (!opened) return send_end(parent, opened.error());
    const auto files = (*library)->read_directory(opened->name_for_libraries());
    if (!files) return send_end(parent, files.error());
    if (!send_end(parent, {})) return false;
    reader::Sender out(parent);
    out.put(static_cast<std::uint32_t>(std::min(files->size(), kMaxDicomFiles)));
    for (const auto& parts : std::span(*files).first(std::min(files->size(), kMaxDicomFiles))) {
      out.put(static_cast<std::uint32_t>(std::min(parts.size(), kMaxParts + 1)));
      for (const std::string& part : std::span(parts).first(std::min(parts.size(), kMaxParts + 1)))
        out.put(part.substr(0, kMaxPart + 1));
    }
    return out.ok();
  });
  if (!process) return at_file(directory, process.error());
  const Files named{&directory, 1};
  if (auto result = wait_for_files(**process, itself, named, progress); !result) return result.error();
  reader::Receiver in(**process, "is damaged: ");
  std::uint32_t count = 0;
  in.get(count);
  if (count > kMaxDicomFiles) return impossible_volume(named);

  FoundFiles found;
  const fs::path folder = directory.parent_path().empty() ? fs::path(".") : directory.parent_path();
  found.roots = {directory, folder};
  std::size_t missing = 0;
  std::set<fs::path> files;
  for (std::uint32_t n = 0; n < count && in.ok(); ++n) {
    if (progress.stopped()) return Progress::interrupted();
    std::uint32_t length = 0;
    in.get(length);
    if (length > kMaxParts + 1) return impossible_volume(named);
    std::vector<std::string> parts(length);
    for (std::string& part : parts) in.get(part, kMaxPart + 1);
    if (!in.ok()) break;
    auto target_path = path_of_part(folder, parts, false);
    if (!target_path)
      return bad_input(directory.string(),
                       "names a file that is not in its folder (ReferencedFileID (0004,1500))",
                       "give its folder: all DICOM files in it are found without the DICOMDIR");
    // some discs are mounted with lower-case names
    std::error_code ignored;
    if (!fs::is_regular_file(*target_path, ignored)) target_path = path_of_part(folder, parts, true);
    if (!fs::is_regular_file(*target_path, ignored)) {
      ++missing;
      continue;
    }
    if (auto stays = check_stays_in(folder, *target_path); !stays) return stays.error();
    files.insert(*target_path);
  }
  if (!in.ok()) return about(in.error(), named);
  found.files.assign(files.begin(), files.end());
  if (missing > 0)
    found.notes.push_back("names " + counted(missing, "file that is", "files that are") + " not there");
  if (found.files.empty())
    return bad_input(directory.string(),
                     "names " + counted(missing, "file that is", "files that are") + " not there",
                     "copy it together with the folders next to it");
  return found;
}

}  // namespace

std::string front_of(const fs::path& file) {
  auto front = read_front(file, Encoding::kRaw, kKindBytes);
  return front ? *std::move(front) : std::string();
}

std::optional<FileKind> dicom_kind_of(const fs::path& file, std::string_view front) {
  // Without the DICM prefix the content is ambiguous; a file with the extension of another format is then not
  // DICOM.
  const bool marked = front.size() > 132 && front.substr(128, 4) == "DICM";
  if (!marked && format_of(file)) return std::nullopt;
  auto kind = kind_of(front, "", 0);
  if (!kind || !kind->dicom) return std::nullopt;
  return kind;
}

std::optional<FileKind> kind_of_dicom_file(const fs::path& file) {
  std::error_code ignored;
  return fs::is_regular_file(file, ignored) ? dicom_kind_of(file, front_of(file)) : std::nullopt;
}

bool is_dicom_directory(const fs::path& file) {
  const auto kind = dicom_kind_of(file, front_of(file));
  return kind && kind->dicom_directory;
}

Result<FoundFiles> find_files(const fs::path& named, const Progress& progress) {
  FoundFiles found;
  found.roots.push_back(named);
  std::error_code ignored;
  if (!fs::is_directory(named, ignored)) {
    if (is_dicom_directory(named)) return files_named_by(named, progress);
    found.files.push_back(named);
    return found;
  }
  constexpr std::size_t kMaxRoots = 32;
  bool more = false, stopped = false;
  std::set<fs::path> outside;
  const std::size_t outside_links = walk(named, [&](const fs::path& file) {
    if ((stopped = progress.stopped())) return true;
    if (found.files.size() == kMaxDicomFiles) return more = true;
    std::error_code unknown;
    // targets of allowed links
    if (reading_limits().follow_links && outside.size() < kMaxRoots && fs::is_symlink(file, unknown))
      outside.insert(fs::canonical(file, unknown).parent_path());
    found.files.push_back(file);
    return false;
  });
  if (stopped) return Progress::interrupted();
  found.roots.insert(found.roots.end(), outside.begin(), outside.end());
  std::sort(found.files.begin(), found.files.end());
  if (more)
    found.notes.push_back("holds more than " + std::to_string(kMaxDicomFiles) +
                          " files; the others were ignored");
  if (outside_links > 0)
    found.notes.push_back(std::to_string(outside_links) +
                          (outside_links == 1 ? " link leads" : " links lead") +
                          " out of the folder and was not followed (--follow-links allows it)");
  return found;
}

Result<DicomLibrary*> ready_dicom_library() {
  const ItkSection section;
  auto library = load_dicom_library();
  if (!library) return library.error();
  if (auto loaded = (*library)->load_dictionary(); !loaded) return loaded.error();
  return *library;
}

Result<std::unique_ptr<reader::ReaderProcess>> start_dicom_reader(const FoundFiles& found,
                                                                  std::size_t shared_bytes,
                                                                  const Progress& progress,
                                                                  const reader::ReaderProcess::Work& work) {
  std::vector<int> descriptors;
  for (const fs::path& root : found.roots)
    if (const int descriptor = ::open(root.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK); descriptor >= 0)
      descriptors.push_back(descriptor);
  auto process = start_reader(descriptors, shared_bytes, progress, work);
  for (const int descriptor : descriptors) ::close(descriptor);
  return process;
}

Result<void> wait_for_files(reader::ReaderProcess& process, const FoundFiles& found, Files named,
                            const Progress& progress) {
  std::size_t begun = 0;
  while (true) {
    std::uint32_t number = 0;
    if (auto received = process.read(std::as_writable_bytes(std::span(&number, 1))); !received) {
      // the file being read can only be identified by its path
      if (begun < found.files.size() && found.files.size() > 1) {
        Error error = about(received.error(), {&found.files[begun], 1});
        if (error.kind == ErrorKind::kBadInput) error.remedy += ", or take it out of the folder";
        return error;
      }
      return about(received.error(), named);
    }
    if (number == kEnd) return receive_end(process, named);
    begun = std::min<std::size_t>(number, found.files.size());
    progress.report("searching for volumes",
                    static_cast<double>(begun) / static_cast<double>(found.files.size()));
  }
}

Error at_file(const fs::path& file, const Error& error) {
  return {error.kind, error.what, file.string(), error.remedy};
}

std::vector<fs::path> dicom_segmentation_files(const fs::path& file) {
  const auto is_segmentation = [](const fs::path& one) {
    const auto kind = kind_of_dicom_file(one);
    return kind && kind->dicom_segmentation;
  };
  std::error_code ignored;
  if (!fs::is_directory(file, ignored))
    return is_segmentation(file) ? std::vector<fs::path>{file} : std::vector<fs::path>{};
  std::vector<fs::path> files;
  bool images = false;
  std::size_t inspected = 0;
  walk(file, [&](const fs::path& inside) {
    images = is_dicom_image(inside);
    if (is_segmentation(inside)) files.push_back(inside);
    return images || ++inspected == kMaxDicomFiles;
  });
  if (images) return {};
  std::ranges::sort(files);
  return files;
}

bool is_dicom_structures(const fs::path& file) {
  const auto kind = kind_of_dicom_file(file);
  return kind && kind->dicom_structures;
}

}  // namespace palpate::volume_io

namespace palpate {

namespace fs = std::filesystem;
using namespace volume_io;

bool is_dicom(const std::filesystem::path& file) {
  std::error_code ignored;
  if (fs::is_regular_file(file, ignored)) return is_dicom_image(file) || is_dicom_directory(file);
  if (!fs::is_directory(file, ignored)) return false;
  std::size_t inspected = 0;
  bool found = false;
  walk(file, [&](const fs::path& inside) {
    found = is_dicom_image(inside);
    return found || ++inspected == kMaxDicomFiles;
  });
  return found;
}

bool is_structure_set(const std::filesystem::path& file) {
  return is_dicom_structures(file);
}

}  // namespace palpate
