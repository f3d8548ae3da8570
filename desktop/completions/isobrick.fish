# fish completion for isobrick: commands, options and their choices are those of --help.
function __isobrick_complete
    set -l words (commandline -opc)
    if test (count $words) -eq 1
        isobrick --help | sed -n '/^Subcommands:/,/^$/ s/^  \([a-z]*\) *\(.*\)/\1\t\2/p'
        return
    end
    set -l help (isobrick $words[2] --help 2>/dev/null | sed -zE 's/\n {38}/\t/g')
    if string match -q -- '-*' (commandline -ct)
        printf '%s\n' $help | sed -nE '/\t/!s/^.{38}/&\t/; s/^  (-.,)?(--[a-z0-9-]+)[^\t]*\t([^.;]*).*/\2\t\3/p'
    else if string match -q -- '-*' $words[-1]
        printf '%s\n' $help | sed -nE "s/^  (-.,)?$words[-1] [^ ]*\{([^}]*)\}.*/\2/p" | tr , '\n'
    end
end
complete -c isobrick -a '(__isobrick_complete)'
