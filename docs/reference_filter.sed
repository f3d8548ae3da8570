# Comments of the headers, which are plain `//`, as Doxygen reads them: before a declaration, behind a member (more
# lines of those are set in deep), and first in a file. Two dots end no sentence; lines that are set in stay lines.
1s#^// (All of isobrick .*)#/// \\mainpage isobrick\n/// \1#
1s#^// #/// \\file\n/// #
s#^( {0,8})//( ?)#\1///\2#
s#^ {9,}//#&/<#
/^ *(class|struct|namespace|\}|#)/!s#([^ /] +)//( .*)$#\1///<\2#
\#///#s# \.\. #\&nbsp;..\&nbsp;#g
s#^( *///   ? ?)([^ ].*)#\1\2<br>#
s#::Type;#::%Type;#
