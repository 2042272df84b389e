#include "catalog/fetch_files.h"

#include "catalog/download.h"
#include "catalog/local_data.h"
#include "palpate/volume_io/volume_io.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

Result<void> fetch_file(const CatalogEntry& entry, const CatalogFile& file, const fs::path& folder,
                        const FetchOptions& options, const Progress& progress) {
  const fs::path target = folder / file.name;
  if (check_content(target, file.bytes, file.sha256, file.git_blob)) return {};
  std::string base = options.mirror.empty() ? entry.home : options.mirror;
  while (base.ends_with('/')) base.pop_back();
  Download request;
  request.url = base + "/" + file.remote;
  request.target = target;
  request.bytes = file.bytes;
  request.sha256 = file.sha256;
  request.git_blob = file.git_blob;
  request.allow_http = options.mirror.starts_with("http://");
  request.stall_timeout_s = options.stall_timeout_s;
  request.attempts = options.attempts;
  return download(request, progress);
}

// removes a scan whose grid differs from the labels'
void drop_foreign_scan(const CatalogEntry& entry, const fs::path& folder, const Warn& warn) {
  const fs::path scan = folder / file_for(entry, DataRole::kScan).name;
  std::error_code ignored;
  if (!fs::exists(scan, ignored)) return;
  const auto labels_header = read_header(folder / file_for(entry, DataRole::kLabels).name);
  const auto scan_header = read_header(scan);
  if (labels_header && scan_header && labels_header->geometry.same_grid(scan_header->geometry, 0.01)) return;
  fs::remove(scan, ignored);
  if (warn)
    warn("the image " + scan.filename().string() + " does not lie on the label map's grid and was dropped" +
         (scan_header ? "" : " (" + scan_header.error().what + ")"));
}

}  // namespace

Result<void> fetch_files(const CatalogEntry& entry, const fs::path& folder, const FetchOptions& options,
                         const Progress& progress, const Warn& warn) {
  for (const auto& file : entry.files) {
    const auto fetched = fetch_file(entry, file, folder, options, progress);
    if (fetched) continue;
    if (file.required || fetched.error().kind != ErrorKind::kUnavailable) return fetched;
    if (warn) warn("without the extra " + file.name + ": " + fetched.error().message());
  }
  drop_foreign_scan(entry, folder, warn);
  return {};
}

}  // namespace palpate
