# Makes Doxygen read the comments of the headers, which are plain `//`: those before a declaration as its
# description, those behind a member as the member's, and the first ones of a file as the file's. Lines that
# are set in stay as they are set.
function text_of(comment,    n, i, parts, out) {
  # Angle brackets outside of `code` are no HTML.
  n = split(comment, parts, "`")
  out = ""
  for (i = 1; i <= n; ++i) {
    if (i % 2 == 1) {
      gsub(/[<>#]/, "\\\\&", parts[i])
      gsub(/ \.\. /, "\\&nbsp;..\\&nbsp;", parts[i])  # no end of a sentence
    }
    out = out (i > 1 ? "`" : "") parts[i]
  }
  return out
}
FNR == 1 && /^\/\// { print FILENAME ~ /isobrick\/isobrick.h$/ ? "/// \\mainpage isobrick" : "/// \\file" }
# A line that is a comment and nothing else.
/^ *\/\// {
  match($0, /^ */)
  indent = RLENGTH
  comment = substr($0, indent + 3)
  if (indent == trailing_at && trailing_at > 0) {  # goes on behind a member
    print substr($0, 1, indent) "///<" text_of(comment)
    next
  }
  trailing_at = 0
  set_in = comment ~ /^   +[^ ]/
  if (set_in && !was_set_in) print substr($0, 1, indent) "///"
  if (!set_in && was_set_in && comment !~ /^ *$/) print substr($0, 1, indent) "///"
  print substr($0, 1, indent) "///" (set_in ? "    " comment : text_of(comment))
  was_set_in = set_in
  next
}
{ was_set_in = 0 }
# What every type has says the same everywhere.
/^ *bool operator==\(.*= default;$/ { print $0 "  ///< Whether all members are equal."; trailing_at = 0; next }
/^ *(explicit )?[A-Z][A-Za-z]*&? ?(operator=)?\([A-Z][A-Za-z]*&&( other)?\) noexcept/ {
  match($0, /^ */)
  print substr($0, 1, RLENGTH) "/// Takes over what the other one has."
}
# A member or a value with a comment behind it.
/[;,{}] +\/\/ / || /[A-Za-z0-9_)] +\/\/ / {
  if (match($0, /  \/\/ /)) {
    trailing_at = RSTART + 1
    if ($0 !~ /\) *(const)? *\{? *  \/\/ / && $0 !~ /^ *(#|class |struct |namespace |\})/) {
      print substr($0, 1, RSTART + 1) "///<" text_of(substr($0, RSTART + 4))
      next
    }
  }
}
{ trailing_at = 0; print }
