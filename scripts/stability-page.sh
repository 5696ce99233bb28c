#!/bin/sh
# What docs/stability.md shows of the page that `bismar study stability` writes: scripts/stability-page.sh OUT/stability.md
exec awk 'BEGIN { shown = 1 } { sub(/see its shares below/, "its shares are on the page that the command writes") } /^## /{ shown = !/[Oo]n average|[Mm]eans|Shares|[Cc]ontrols/ } shown
    END { print "\nMeans, controls, averages and shares are on the page that the command writes." }' "$1"
