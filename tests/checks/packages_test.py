#!/usr/bin/env python3
"""What tools/make_packages makes of a build: Debian packages that follow policy, install, and leave no files after
removal; an archive and a wheel that run in another place with only their bundled libraries and reproduce the build's
run hash.

    packages_test.py BUILD
"""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import unittest

sys.dont_write_bytecode = True
BUILD = pathlib.Path(sys.argv[1]).resolve()
SOURCE = pathlib.Path(__file__).resolve().parents[2]
DEBS = ("palpate", "libpalpate1", "libpalpate-dev", "python3-palpate")
SCENE = "knee-phantom:spacing=2"
# Debian's Python, which has NumPy
PYTHON = "/usr/bin/python3"
# read the libraries that are loaded, and the hash of a run
RUN = f"""
import palpate as pp, sys
run = pp.simulate({SCENE!r}, seed=1)
print(f"{{run.hash:016x}}")
print("\\n".join(sorted({{line.split()[-1] for line in open("/proc/self/maps") if ".so" in line}})))
"""


def run(*command, **options):
    done = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False, **options)
    if done.returncode:
        raise AssertionError(f"{' '.join(map(str, command))}:\n{done.stdout}")
    return done.stdout


def lacking(*programs):
    """Names of the programs that are not here."""
    return [program for program in programs if shutil.which(program) is None]


class Packages(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="palpate-packages-")
        cls.addClassCleanup(folder.cleanup)
        cls.root = pathlib.Path(folder.name)
        cls.environment = {"PATH": "/usr/bin:/bin", "HOME": str(cls.root), "LC_ALL": "C", "PALPATE_CACHE": str(cls.root / "cache")}
        cls.out = cls.root / "out"
        cls.listed = run(PYTHON, SOURCE / "tools/make_packages", BUILD, cls.out)
        cls.debs = {path.name.split("_")[0]: path for path in cls.out.glob("*.deb")}
        cls.hash = cls.run_hash(BUILD / "apps/palpate/palpate")

    @classmethod
    def run_hash(cls, program):
        return re.search(r"^run hash (\w+)", run(program, "simulate", SCENE, "--seed", "1", env=cls.environment), re.MULTILINE)[1]

    def skip_unless(self, *programs):
        if absent := lacking(*programs):
            self.skipTest(f"not installed: {', '.join(absent)}")

    def names_no_folder_of_the_build(self, folder):
        for path in folder.rglob("*"):
            if path.is_file() and not path.is_symlink():
                data = path.read_bytes()
                for here in (bytes(SOURCE), bytes(BUILD)):
                    self.assertNotIn(here, data, path)

    def test_the_packages_are_those_that_are_promised(self):
        self.assertEqual(sorted(self.debs), sorted(DEBS))
        for path in self.debs.values():
            self.assertLess(path.stat().st_size, 5e6, self.listed)
        for name in DEBS:
            fields = dict(re.findall(r"^ ?(\w[\w-]*): (.*)$", run("dpkg-deb", "--field", self.debs[name]), re.MULTILINE))
            self.assertEqual(fields["Package"], name)
            self.assertRegex(fields["Maintainer"], r"^.+ <.+@.+>$")
            self.assertTrue(fields["Description"])
            if name != "libpalpate1":
                self.assertIn(f"libpalpate1 (= {fields['Version']})", fields["Depends"])
            if name in ("palpate", "libpalpate1"):
                self.assertIn("libhdf5-103", fields["Depends"])

    def test_their_files_are_where_debian_has_them(self):
        tree = self.root / "tree"
        for deb in self.debs.values():
            run("dpkg-deb", "--extract", deb, tree)
        for name in ("usr/bin/palpate", "usr/bin/palpate-verify", "usr/lib/libpalpate.so.1", "usr/lib/libpalpate.so",
                     "usr/lib/palpate/libpalpate_dicom.so", "usr/include/palpate.h", "usr/include/palpate/servo/servo_loop.h",
                     "usr/lib/pkgconfig/palpate.pc", "usr/lib/cmake/palpate/palpate-c-targets.cmake", "usr/share/man/man1/palpate.1.gz",
                     "usr/share/man/man1/palpate-simulate.1.gz", "usr/lib/python3/dist-packages/palpate/__init__.py",
                     "usr/lib/udev/rules.d/60-palpate-haptics.rules", "usr/share/palpate/system/palpate-limits.conf",
                     *(f"usr/share/doc/{name}/{file}" for name in DEBS for file in ("copyright", "changelog.gz"))):
            self.assertTrue((tree / name).exists(), name)
        self.names_no_folder_of_the_build(tree)
        # what two packages both have, dpkg refuses to install
        listings = [set(re.findall(r"^-.* \./(.*)$", run("dpkg-deb", "--contents", deb), re.MULTILINE)) for deb in self.debs.values()]
        self.assertEqual(sum(map(len, listings)), len(set.union(*listings)))
        for path in tree.rglob("*"):
            if not path.is_symlink():
                self.assertEqual(path.stat().st_mode & 0o022, 0, path)
        # runs from there, by the libraries that the package asks for
        self.assertEqual(self.run_hash(tree / "usr/bin/palpate"), self.hash)
        self.assertEqual(run("readelf", "--symbols", "--wide", tree / "usr/bin/palpate").count(".symtab"), 0)

    def test_lintian_has_no_errors_and_no_warnings(self):
        self.skip_unless("lintian")
        # CPack writes maintainer scripts that call ldconfig for every package with a library
        run("lintian", "--fail-on", "error,warning", "--suppress-tags",
            "pkg-config-unavailable-for-cross-compilation,maintscript-calls-ldconfig", *self.debs.values())

    def test_they_install_and_leave_nothing_in_a_bare_system(self):
        self.skip_unless("mmdebstrap")
        if subprocess.run(["unshare", "--user", "--map-root-user", "true"], stderr=subprocess.DEVNULL, check=False).returncode:
            self.skipTest("user namespaces are forbidden here")
        before, after, sizes = (self.root / name for name in ("before.txt", "after.txt", "sizes.txt"))
        listing = "cd \"$1\" && find usr etc var/lib -xdev | grep -v -e '^var/lib/dpkg' -e '^var/lib/apt' | sort >"
        measure = f"chroot \"$1\" dpkg-query --show --showformat='${{Installed-Size}}\\n' | awk '{{ sum += $1}} END {{print sum }}' >>{sizes}"
        names = " ".join(f"/debs/{path.name}" for path in self.debs.values())
        (self.out / "use.sh").write_text(f"""palpate --version
palpate simulate {SCENE} --seed 1 | tee /tmp/run.txt
grep -q {self.hash} /tmp/run.txt
python3 -c 'import palpate as pp; print(format(pp.simulate("{SCENE}", seed=1).hash, "016x"))' | grep -q {self.hash}
! command -v cc
""")
        # the wheel brings its libraries: before any package of palpate, with Python and NumPy alone
        (self.out / "use_wheel.sh").write_text(f"""apt-get install --yes --no-install-recommends python3-pip python3-numpy
pip install --break-system-packages --no-index --no-deps /debs/*.whl
palpate simulate {SCENE} --seed 1 | grep {self.hash}
python3 -c 'import palpate as pp; print(format(pp.simulate("{SCENE}", seed=1).hash, "016x"))' | grep {self.hash}
pip uninstall --yes --break-system-packages palpate
! command -v palpate
apt-get purge --yes --autoremove python3-pip python3-numpy
""")
        run("mmdebstrap", "--mode=unshare", "--variant=apt", f"--customize-hook=copy-in {self.out} /",
            "--customize-hook=mv \"$1/out\" \"$1/debs\"", f"--customize-hook={listing} {before}",
            "--customize-hook=chroot \"$1\" sh -e -c 'apt-get update && sh -e /debs/use_wheel.sh'",
            f"--customize-hook={measure}",
            f"--customize-hook=chroot \"$1\" sh -c 'apt-get update && apt-get install --yes --no-install-recommends {names}'",
            f"--customize-hook={measure}",
            "--customize-hook=chroot \"$1\" sh -e /debs/use.sh",
            f"--customize-hook=chroot \"$1\" sh -c 'apt-get purge --yes --autoremove {' '.join(DEBS)}'",
            f"--customize-hook={listing} {after}", "bookworm", "/dev/null")
        empty_kB, full_kB = (int(line) for line in sizes.read_text().split())
        print(f"all packages with their dependencies: {(full_kB - empty_kB) / 1e3:.0f} MB")
        self.assertLess(full_kB - empty_kB, 300e3)
        left = set(after.read_text().splitlines()) - set(before.read_text().splitlines())
        self.assertFalse([path for path in left if "palpate" in path])

    def test_the_archive_runs_from_any_folder(self):
        packed = next(self.out.glob("palpate-*-linux-*.tar.xz"))
        with tarfile.open(packed) as archive:
            archive.extractall(self.root / "elsewhere")
        top = next((self.root / "elsewhere").iterdir())
        self.names_no_folder_of_the_build(top)
        self.assertEqual(self.run_hash(top / "bin/palpate"), self.hash)
        self.assertTrue((top / "share/man/man1/palpate.1").is_file())
        loaded = re.findall(r"=> (/\S+)", run("ldd", top / "bin/palpate", env=self.environment))
        self.comes_from(top, loaded)

    def comes_from(self, folder, libraries):
        """Each library lies below a folder, or is one of the system's own."""
        system = re.compile(r"(ld-linux.*|lib(c|m|dl|rt|pthread|resolv|util|stdc\+\+|gcc_s)[.-].*)$")
        elsewhere = [path for path in libraries if not pathlib.Path(path).is_relative_to(folder) and not system.match(pathlib.Path(path).name)]
        self.assertFalse(elsewhere)
        self.assertTrue([path for path in libraries if "libhdf5" in path])

    def test_the_wheel_is_installed_by_pip_and_brings_what_it_loads(self):
        wheel = next(self.out.glob("*.whl"))
        self.assertRegex(wheel.name, r"^palpate-[\d.]+-py3-none-manylinux_2_\d+_\w+\.whl$")
        home = self.root / "venv"
        run(PYTHON, "-m", "venv", "--system-site-packages", home, env=self.environment)
        run(home / "bin/python", "-m", "pip", "install", "--no-index", "--no-deps", "--disable-pip-version-check", wheel, env=self.environment)
        run_hash, *loaded = run(home / "bin/python", "-c", RUN, env=self.environment).split("\n")
        self.assertEqual(run_hash, self.hash)
        site = next((home / "lib").glob("python3*/site-packages"))
        # Python's own extensions and NumPy's are not palpate's
        ours = [path for path in loaded if path and "/python3" not in path.replace(str(site), "") and "/lib/python" not in path.replace(str(site), "")]
        numpys = re.compile(r"/(libblas|liblapack|libgfortran|libquadmath|libffi|libopenblas|libz|libexpat|libcrypto|libssl|libbz2|liblzma)")
        self.comes_from(site / "palpate", [path for path in ours if str(site) in path or not numpys.search(path)])
        self.assertIn("palpate 1", run(home / "bin/palpate", "--version", env=self.environment))
        self.assertEqual(self.run_hash(home / "bin/palpate"), self.hash)
        licences = next(site.glob("palpate-*.dist-info")) / "licenses"
        names = {path.name for path in licences.iterdir()}
        self.assertTrue({"palpate", "uplot"} <= names, names)
        self.assertTrue(any(name.startswith("libhdf5-103") for name in names), names)
        used = max(int(minor) for path in (site / "palpate").rglob("*") if path.is_file() and path.read_bytes()[:4] == b"\x7fELF"
                   for minor in re.findall(r"GLIBC_2\.(\d+)", run("objdump", "-T", path)))
        self.assertIn(f"manylinux_2_{used}_", wheel.name)
        run(home / "bin/python", "-m", "pip", "uninstall", "--yes", "palpate", env=self.environment)
        self.assertFalse(list(site.glob("palpate*")))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=1)
