"""Compiles the C++ peers when they are first used, and again when their source, compiler, libraries or flags change."""

import hashlib
import importlib.metadata
import os
import platform
import re
import shutil
import subprocess
from pathlib import Path

HERE = Path(__file__).parent
BUILT = HERE / "build"
FLAGS = ("-O3", "-march=native", "-std=c++17", "-DNDEBUG")
SHARED = ("-shared", "-fPIC")
# Ceres comes with an Eigen of its own, and compiled for any processor: with the alignment of this one, memory that Eigen takes in
# the program and gives back in the library, or the other way round, would be given back wrongly.
CERES = ("-I/usr/include/eigen3", "-DEIGEN_MAX_ALIGN_BYTES=16")
CERES_LIBRARIES = ("-lceres", "-lglog")


class MissingPeer(RuntimeError):
    """A program to compare with is not there; a benchmark without its peer has failed."""


class NotInstalled(MissingPeer):
    """A library that only some machines have is missing; a benchmark against it leaves its row out."""


def compiler() -> str:
    """The C++ compiler: $CXX, or g++."""
    name = os.environ.get("CXX", "g++")
    path = shutil.which(name)
    if path is None:
        raise MissingPeer(f"the C++ peers need a compiler and '{name}' is not on the PATH: apt install g++, or set CXX")
    return path


def compiler_version() -> str:
    """First line of what the compiler says about itself."""
    return subprocess.run([compiler(), "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]


def eigen() -> tuple[str, Path]:
    """Version and include folder of Eigen, whose headers the package cmeel-eigen brings."""
    try:
        package = importlib.metadata.distribution("cmeel-eigen")
    except importlib.metadata.PackageNotFoundError as error:
        raise MissingPeer("the C++ peers need the headers of Eigen: pip install 'whiskjax[bench]'") from error
    return package.version, Path(str(package.locate_file("cmeel.prefix/include/eigen3")))


def ceres() -> str:
    """Version of Ceres, which the system's package libceres-dev brings.

    **Raises:** `NotInstalled` where it is missing.
    """
    command = [compiler(), "-E", "-dM", "-include", "ceres/version.h", "-x", "c++", "/dev/null"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise NotInstalled("libceres-dev is not installed")
    found = dict(re.findall(r"^#define CERES_VERSION_(\w+) (\d+)$", done.stdout, re.MULTILINE))
    return "{MAJOR}.{MINOR}.{REVISION}".format(**found)


def library(name: str) -> Path:
    """The shared library built from `name`.cpp with Eigen."""
    version, headers = eigen()
    return _built(name, ".so", version, (*FLAGS, *SHARED, f"-I{headers}"))


def ceres_program(name: str) -> Path:
    """The program built from `name`.cpp with Ceres.

    **Raises:** `NotInstalled` where libceres-dev is missing.
    """
    return _built(name, "", ceres(), (*FLAGS, *CERES), CERES_LIBRARIES)


def _built(name: str, suffix: str, version: str, flags: tuple[str, ...], libraries: tuple[str, ...] = ()) -> Path:
    """What `name`.cpp compiles to.

    The file is named after everything that goes into it: the source, every header, the flags, the versions of the library and of
    the compiler and, because of -march=native, the processor with its instruction sets.
    """
    cxx = compiler()
    content = hashlib.sha256("\n".join([*flags, *libraries, version, compiler_version(), *_processor()]).encode())
    for source in (HERE / f"{name}.cpp", *sorted(HERE.glob("*.hpp"))):
        content.update(source.read_bytes())
    target = BUILT / f"{name}-{content.hexdigest()[:16]}{suffix}"
    if not target.exists():
        BUILT.mkdir(exist_ok=True)
        unfinished = target.with_suffix(f".{os.getpid()}")
        command = [cxx, *flags, "-o", str(unfinished), str(HERE / f"{name}.cpp"), *libraries]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise MissingPeer(f"the peer {name}.cpp does not compile:\n{' '.join(command)}\n{done.stderr}")
        unfinished.replace(target)  # at once, so that two processes building it never load half a file
    return target


def processor() -> str:
    """The processor's name, family and model, as far as the system tells."""
    return _processor()[0]


def _processor() -> tuple[str, str]:
    """Name with family and model, and instruction sets."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine(), ""
    found = {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)}
    name, model = found.get("model name", platform.machine()), ""
    if "cpu family" in found and "model" in found:  # a virtual machine often tells no more than "AMD EPYC"
        model = f" (family {found['cpu family']}, model {found['model']})"
    return name + model, found.get("flags", "")
