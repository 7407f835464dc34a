#!/bin/sh
# Make certificates for the hosts of a graph, and for whoever else may listen:
#   sh certificates.sh FOLDER HOST [HOST…]
# FOLDER gets ca.pem, which everybody needs, and of each host HOST.pem and HOST.key, which go to that
# host alone. The common name is the host's name in the graph; the names it is reached by follow as
# HOST=NAME. ca.key signs more of them later: keep it apart, and off every host.
set -eu
umask 077
folder=$1; shift
mkdir -p "$folder"; cd "$folder"
new="-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes"
[ -f ca.pem ] || openssl req -x509 $new -keyout ca.key -out ca.pem -days 3650 -subj "/CN=rsenf"
for item in "$@"; do
    host=${item%%=*}; name=${item#*=}
    openssl req $new -keyout "$host.key" -out "$host.csr" -subj "/CN=$host"
    cat > "$host.ext" <<END
subjectAltName=DNS:$name,DNS:$host,DNS:localhost
basicConstraints=critical,CA:false
extendedKeyUsage=serverAuth,clientAuth
END
    openssl x509 -req -in "$host.csr" -CA ca.pem -CAkey ca.key -CAcreateserial \
        -days 825 -out "$host.pem" -extfile "$host.ext"
    rm "$host.csr" "$host.ext"
done
