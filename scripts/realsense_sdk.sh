#!/usr/bin/env bash
# Makes a librealsense to build and test the feature `realsense` against: scripts/realsense_sdk.sh PREFIX [VERSION]
#
# The library is the one inside the Python package pyrealsense2, which exports the C interface too. It wants Python's symbols when
# it is loaded, though not one of them is called through that interface: a stub gives it those. For CI and development only; never
# ship it. Users install the library of its makers (docs/realsense.md).
#
# Then: PKG_CONFIG_PATH=PREFIX/lib/pkgconfig LD_LIBRARY_PATH=PREFIX/lib cargo test --features realsense
set -euo pipefail

[ $# -ge 1 ] || { echo "usage: $0 PREFIX [VERSION]" >&2; exit 2; }
mkdir -p "$1"
prefix=$(cd "$1" && pwd)
version=${2:-2.56.5.9235}
api=${version%.*}
abi=${api%.*}

for tool in patchelf readelf strip cc python3; do
    command -v "$tool" >/dev/null || { echo "$0: needs $tool (packages patchelf, binutils, gcc, python3)" >&2; exit 1; }
done
[ "$(uname -m)" = x86_64 ] || { echo "$0: the package is taken for x86_64 only; this is $(uname -m)" >&2; exit 1; }

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

python3 -m pip download --quiet --no-deps --only-binary=:all: --implementation cp --python-version 3.11 --abi cp311 \
    --platform manylinux1_x86_64 --dest "$scratch" "pyrealsense2==$version"
python3 -m zipfile -e "$scratch"/pyrealsense2-*.whl "$scratch/wheel"
shared_object=
for file in "$scratch"/wheel/pyrealsense2/pyrealsense2.cpython-*.so*; do
    [[ $file == *.debug ]] || { shared_object=$file; break; }
done
mkdir -p "$prefix/lib/pkgconfig"

# Functions are bound when called, so that they abort; data has to be there when the library is loaded.
stub=librs_pystub.so.0
{
    echo '#include <stdlib.h>'
    readelf -rW "$shared_object" |
        awk '$5 ~ /^_?Py/ { print ($3 ~ /JUMP_SLO/ ? "function" : "data"), $5 }' | sort -u -k2,2 |
        awk '$1 == "function" { print "void " $2 "(void) { abort(); }" } $1 == "data" { print "char " $2 "[1024];" }'
} >"$scratch/stub.c"
cc -shared -fPIC -O1 -Wl,-soname,"$stub" -o "$prefix/lib/$stub" "$scratch/stub.c"

library=librealsense2.so.$api
install -m 755 "$shared_object" "$scratch/$library"
strip --strip-unneeded "$scratch/$library"
# One edit a call: patchelf 0.14 mixes the values up when they share one.
patchelf --set-soname "librealsense2.so.$abi" "$scratch/$library"
patchelf --add-needed "$stub" "$scratch/$library"
# shellcheck disable=SC2016 # $ORIGIN is for the dynamic loader
patchelf --set-rpath '$ORIGIN' "$scratch/$library"
ln -sf "$library" "$prefix/lib/librealsense2.so.$abi"
ln -sf "librealsense2.so.$abi" "$prefix/lib/librealsense2.so"
cat >"$prefix/lib/pkgconfig/realsense2.pc" <<END
prefix=$prefix
libdir=\${prefix}/lib
Name: realsense2
Description: C interface of librealsense, for tests
Version: $api
Libs: -L\${libdir} -lrealsense2
END
# Last and in one step: a prefix that has it is complete.
mv "$scratch/$library" "$prefix/lib/$library.part"
mv "$prefix/lib/$library.part" "$prefix/lib/$library"
echo "$prefix/lib/$library"
