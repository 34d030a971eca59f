#!/bin/sh
# Rebuilds three.bundle.min.js in this folder: needs npm, works in a temporary folder. Versions are in SOURCES.md.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm pack --silent three@0.187.0 esbuild@0.28.2 @esbuild/linux-x64@0.28.2 >/dev/null
unpack() { mkdir -p "$2" && tar -xzf "$1" -C "$2" --strip-components=1; }
unpack three-0.187.0.tgz node_modules/three
unpack esbuild-linux-x64-0.28.2.tgz esbuild
cp "$here/entry.js" entry.js
esbuild/bin/esbuild entry.js --bundle --minify --format=iife --global-name=THREE --target=es2020 \
  --legal-comments=none --log-level=warning --outfile="$here/three.bundle.min.js"
cp node_modules/three/LICENSE "$here/LICENSE.three.txt"
