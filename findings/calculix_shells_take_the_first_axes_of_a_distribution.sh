#!/usr/bin/env bash
# CalculiX 2.20 (Debian 12): a *SHELL SECTION whose *ORIENTATION names a *DISTRIBUTION gives all of
# its elements the axes of the first line. There is no error and no warning; the manual says that
# distributions are for *SOLID SECTION. Below, the second shell is to be stiff along y, is equally
# strained along x and y, and carries its stress along x. An *ORIENTATION and a *SHELL SECTION for
# each element do what they say.
# Needs Debian's package: apt-get install calculix-ccx
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
{ ccx -v || true; } | grep -F "Version 2.20"
mesh='*NODE
1, 0., 0., 0.
2, 1., 0., 0.
3, 0., 1., 0.
4, 5., 0., 0.
5, 6., 0., 0.
6, 5., 1., 0.
*ELEMENT, TYPE=S3, ELSET=FIRST
1, 1, 2, 3
*ELEMENT, TYPE=S3, ELSET=SECOND
2, 4, 5, 6
*ELSET, ELSET=BOTH
FIRST, SECOND
*MATERIAL, NAME=CLOTH
*ELASTIC, TYPE=ENGINEERING CONSTANTS
100., 1., 1., 0., 0., 0., 1., 1.,
1.'
strained='*STEP
*STATIC
*BOUNDARY
1, 1, 3, 0.
2, 1, 1, .001
2, 2, 3, 0.
3, 1, 1, 0.
3, 2, 2, .001
3, 3, 3, 0.
4, 1, 3, 0.
5, 1, 1, .001
5, 2, 3, 0.
6, 1, 1, 0.
6, 2, 2, .001
6, 3, 3, 0.
*EL PRINT, ELSET=BOTH, GLOBAL=YES
S
*END STEP'
cat > distributed.inp <<DECK
$mesh
*DISTRIBUTION, NAME=AXES
, 1., 0., 0., 0., 1., 0.
1, 1., 0., 0., 0., 1., 0.
2, 0., 1., 0., -1., 0., 0.
*ORIENTATION, NAME=WARP, SYSTEM=RECTANGULAR
AXES
*SHELL SECTION, ELSET=BOTH, MATERIAL=CLOTH, ORIENTATION=WARP
.1
$strained
DECK
cat > sections.inp <<DECK
$mesh
*ORIENTATION, NAME=ALONG_X, SYSTEM=RECTANGULAR
1., 0., 0., 0., 1., 0.
*ORIENTATION, NAME=ALONG_Y, SYSTEM=RECTANGULAR
0., 1., 0., -1., 0., 0.
*SHELL SECTION, ELSET=FIRST, MATERIAL=CLOTH, ORIENTATION=ALONG_X
.1
*SHELL SECTION, ELSET=SECOND, MATERIAL=CLOTH, ORIENTATION=ALONG_Y
.1
$strained
DECK
for job in distributed sections; do
    ccx -i $job > $job.log
    if grep -iE "warning|error" $job.log; then exit 1; fi
    echo "$job: stresses of the second shell along x and y:" \
        "$(awk '$1 == 2 && $2 == 1 { print $3, $4 }' $job.dat)"
done
awk '$1 == 2 { if ($3 < 50 * $4) exit 1 }' distributed.dat
awk '$1 == 2 { if ($4 < 50 * $3) exit 1 }' sections.dat
