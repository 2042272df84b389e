#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

#include "palpate/records/records.h"

// any bytes as a records file give displayable rows or one error
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  // in memory, one folder per fuzzing process
  static const std::string folder = [] {
    std::string pattern = "/dev/shm/palpate-records-fuzzer-XXXXXX";
    if (::mkdtemp(pattern.data()) == nullptr) std::abort();
    static std::string created = pattern;
    std::atexit([] {
      std::error_code ignored;
      std::filesystem::remove_all(created, ignored);
    });
    return pattern;
  }();
  const std::string file = folder + "/records.db";
  for (const char* rest : {"", "-wal", "-shm", "-journal"}) ::unlink((file + rest).c_str());
  {
    std::ofstream out(file, std::ios::binary);
    out.write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  }
  auto records = palpate::Records::open_to_read(file);
  if (!records) {
    if (records.error().what.empty()) std::abort();
    return 0;
  }
  std::int64_t some = 0;
  (void)(*records)->list({}, [&](const palpate::RunRecord& run) -> palpate::Result<void> {
    some = run.id;
    (void)palpate::csv_rows(run);
    (void)palpate::xapi_statement(run, "https://a.example",
                                  [](std::string_view name) { return std::string(name); });
    return {};
  });
  if (const auto run = (*records)->run(some); run.ok()) (void)palpate::csv_rows(*run);
  return 0;
}
