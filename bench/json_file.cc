#include "json_file.h"

#include <cstdio>
#include <fstream>

namespace palpate::bench {

int write_json(const std::string& program, const std::string& path, const nlohmann::json& figures) {
  if (path.empty()) return 0;
  std::ofstream file(path);
  file << figures.dump(2) << '\n';
  file.close();
  if (file) return 0;
  std::fprintf(stderr, "%s: %s could not be written\n", program.c_str(), path.c_str());
  return 4;
}

}  // namespace palpate::bench
