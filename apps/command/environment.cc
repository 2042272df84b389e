#include "environment.h"

#include <malloc.h>

#include <cstdlib>
#include <initializer_list>

namespace palpate::app {

void sanitise_environment() {
  // variables of the dynamic linker are omitted: they take effect before main, and the linker itself ignores
  // them for a program with capabilities
  for (const char* name : {
           "ITK_AUTOLOAD_PATH",                                                           // ITK's factories
           "HDF5_PLUGIN_PATH", "HDF5_PLUGIN_PRELOAD", "HDF5_VOL_CONNECTOR",               // HDF5's filters,
           "HDF5_DRIVER", "HDF5_DRIVER_CONFIG",                                           // ... drivers
           "OPENSSL_CONF", "OPENSSL_CONF_INCLUDE", "OPENSSL_ENGINES", "OPENSSL_MODULES",  // OpenSSL's engines
           "DCMDICTPATH",                       // DCMTK's dictionary
           "SSLKEYLOGFILE",                     // curl: keys, in clear
           "GCONV_PATH", "LOCPATH", "NLSPATH",  // glibc's conversions
       })
    ::unsetenv(name);
}

void keep_freed_memory() {
  // larger blocks, such as whole volumes, are returned when they are freed
  constexpr int kMaxKeptBlock_bytes = 64 << 20;
  constexpr int kMaxKept_bytes = 256 << 20;
  ::mallopt(M_MMAP_THRESHOLD, kMaxKeptBlock_bytes);
  ::mallopt(M_TRIM_THRESHOLD, kMaxKept_bytes);
}

}  // namespace palpate::app
